"""What a person may ask of the events."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StepToEvent:
    """Pause, and show the nearest frame with an event. Forwards, frames are computed until there is one."""

    forwards: bool = True
    alarming: bool = False
    """Warnings and losses only."""


@dataclass(frozen=True)
class NextEvent:
    """What a run goes on towards: the next event."""

    alarming: bool = False
