"""Runs of sources that were closed because another one was opened. They are kept with their forks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...engine.options import SourceOptions
from ..current_run import CurrentRun
from .branches import Branch

MOST_KEPT = 8
"""Most runs that are kept, including forks, because each has threads and files. The oldest sources are discarded."""


@dataclass(frozen=True, eq=False)
class Kept:
    """The run of a source and its forks."""

    number: int
    """Its identity."""
    source: str
    name: str
    """Of the sequence."""
    options: SourceOptions
    """How the source was opened."""
    branches: tuple[Branch, ...]
    runs: Mapping[int, CurrentRun]
    """By the number of the branch."""


def limited(kept: tuple[Kept, ...]) -> tuple[Kept, ...]:
    """Returns the newest sources with at most MOST_KEPT runs together, and always the newest one."""
    while len(kept) > 1 and sum(len(each.runs) for each in kept) > MOST_KEPT:
        kept = kept[1:]
    return kept
