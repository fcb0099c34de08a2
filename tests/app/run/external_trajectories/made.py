"""Trajectory files of other programs, made from the stand-in sequence's truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from ispom_app.engine.external_trajectories.placed import (
    ExternalTrajectory,
    TrajectoryOption,
    external_trajectory,
    read_options,
)
from ispom_app.engine.playback import truth_from_start

from ispom.geometry import Pose
from ispom.io.trajectories import tum_text
from ispom.types import Sequence, Trajectory

AWAY = Pose.from_rotvec(np.array([0.3, -0.2, 0.5]), np.array([4.0, 5.0, 6.0]))
"""Another program's world."""


def written(path: Path, trajectory: Trajectory) -> Path:
    path.write_text(tum_text(trajectory))
    return path


def elsewhere(sequence: Sequence, unit_m: float = 1.0, right: Pose | None = None) -> Trajectory:
    """The truth as another program has it: in its own world and unit, of a frame at rest in the rig."""
    assert sequence.truth is not None
    moved = sequence.truth.moved(left=AWAY, right=right)
    return Trajectory(moved.times_ns, moved.rotations, moved.translations / unit_m)


def read(path: Path, flag: str = "orb", *alignments: str) -> TrajectoryOption:
    return read_options([f"{flag}={path}"], alignments)[0]


def external(sequence: Sequence, path: Path, flag: str = "orb", *alignments: str) -> ExternalTrajectory:
    return external_trajectory(0, read(path, flag, *alignments), sequence, truth_from_start(sequence))
