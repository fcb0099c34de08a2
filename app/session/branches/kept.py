"""Runs of sources that were closed when another one was opened: all of them stay, with their forks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...engine.options import SourceOptions
from ..current_run import CurrentRun
from .branches import Branch

MOST_KEPT = 8
"""Runs, forks included; the oldest sources make room for new ones. Each holds threads and files."""


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
    """The newest of them, the newest of all always; MOST_KEPT runs at most."""
    while len(kept) > 1 and sum(len(each.runs) for each in kept) > MOST_KEPT:
        kept = kept[1:]
    return kept
