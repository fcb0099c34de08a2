"""The arguments of a command other than its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..engine.playback import Builder


@dataclass(frozen=True)
class Call:
    builder: Builder
    """Makes the estimators."""
    words: Sequence[str] = ()
    """The words on the command line after the command."""
