"""What a person may ask of sweeps."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RunSweep:
    """Run a method of the source with each of a few values of a setting, beside what goes on in the page."""

    method: str
    setting: str
    """As a field of its config."""
    values: str
    """As they were written: `100, 200, 400`."""


@dataclass(frozen=True)
class CancelSweep:
    """No further; what was computed stays."""


@dataclass(frozen=True)
class ShowSwept:
    """Show the run of a value as a branch of the run that is shown."""

    place: int
    """Of the value, counted from 0."""


OfSweeps = RunSweep | CancelSweep | ShowSwept
