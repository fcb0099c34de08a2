"""A run or a recording that is over, as it is opened for review."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ispom.ensemble import Ensemble
from ispom.methods import Config
from ispom.types import Rig, Trajectory

from ...engine.history.record import ExposureRecord
from ...engine.playback import Playback


@dataclass(frozen=True, eq=False)
class Stored:
    """What is shown of a run or of a recording that is over."""

    path: Path
    """The folder, or the recording."""
    playback: Playback
    """At the first exposure: from there it can be replayed, unless `unavailable` says why not."""
    records: Callable[[], Iterator[ExposureRecord]]
    """Every frame that was computed; InputError where one cannot be read."""
    final: Mapping[str, Trajectory]
    """By method: the trajectory that the run ended with, in the method's own world and unit."""
    methods: tuple[str, ...]
    """Whose quantities are known."""
    recording: Path | None = None
    """What Rerun shows of it."""
    recording_id: str = ""
    unavailable: str = ""
    """Why nothing can be computed anew, in one sentence; empty where it can."""


def nobody(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """No estimators, where there is nothing to compute."""
    return Ensemble((), {})
