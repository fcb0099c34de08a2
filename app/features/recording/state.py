"""What is recorded, and what was."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...presentation.texts import size
from ...session.state import FeatureState, State


@dataclass(frozen=True)
class Recording:
    """The recording that is being written."""

    name: str
    size_bytes: int
    written: int
    """Frames in the file so far."""
    closing: bool = False


@dataclass(frozen=True)
class ListedRun:
    """A finished run, or a recording alone, in the recordings folder."""

    name: str
    """The run's folder or the recording, in the recordings folder: opened for review."""
    size_bytes: int
    recording: str = ""
    """Its .rrd, in the recordings folder; empty for a run without one."""
    picture: str = ""
    """A small one, in the recordings folder; empty for none."""
    source: str = ""
    """Of the images, as a person knows it; empty where nothing says."""
    exposures: int = 0
    duration_s: float = 0.0
    note: str = ""
    """A person's own."""


@dataclass(frozen=True)
class Recordings(FeatureState):
    current: Recording | None = None
    listed: tuple[ListedRun, ...] = ()
    """The finished runs and recordings of the folder, newest first."""

    def reduce(self, event: object) -> Recordings:
        return self  # also over another source

    def page(self, state: State) -> dict[str, Any]:
        now = self.current
        found = None if now is None else {"name": now.name, "size": size(now.size_bytes), "closing": now.closing}
        return {"recording": found}
