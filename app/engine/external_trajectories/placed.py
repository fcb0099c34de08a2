"""Trajectories of other programs, which the command line names by `--beside NAME[:FRAME]=FILE`. They are aligned with
the shared world of a run, and interpolated at its frames.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.evaluation.trajectory_error import (
    MIN_POSES,
    Alignment,
    TrajectoryError,
    alignment,
    associate,
    error_against_truth,
    placed,
)
from ispom.geometry import Array, Pose
from ispom.io.files import expanded
from ispom.io.poses.dialect import ROW_NS, TrajectoryFile
from ispom.io.poses.recognised import read_trajectory
from ispom.methods import names
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Rig, Sequence, Trajectory

from ...presentation.colours import Rgb, colour_of_external
from ...presentation.texts import ALIGNMENTS

FLAG, ALIGNMENT_FLAG = "--beside", "--beside-alignment"
FrameOfFile = Literal["rig", "left", "right", "video"]
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
RESERVED = frozenset({"truth"})


@dataclass(frozen=True, eq=False)
class TrajectoryOption:
    """A trajectory file of another program, in its own world and perhaps its own unit."""

    name: str
    file: TrajectoryFile
    frame: FrameOfFile = "rig"
    """The part of the rig whose poses the file holds."""
    alignment: Alignment = "se3"


def read_options(values: Iterable[str], alignments: Iterable[str]) -> tuple[TrajectoryOption, ...]:
    """Reads the files that the flags name. Raises InputError for a mistake in a flag or a file."""
    options: dict[str, TrajectoryOption] = {}
    taken = {name.lower() for name in (*names(), *RESERVED)}
    for value in values:
        name, frame, path = _named(value)
        if name.lower() in taken:
            used = any(other.lower() == name.lower() for other in options)
            what = "another trajectory" if used else "a method" if name.lower() not in RESERVED else "the ground truth"
            raise InputError(f"{FLAG} names a trajectory {name!r}, as {what} is called: choose another name")
        taken.add(name.lower())
        options[name] = TrajectoryOption(name, read_trajectory(expanded(path)), frame)
    for value in alignments:
        name, _, kind = value.partition("=")
        if kind not in get_args(Alignment):
            kinds = ", ".join(get_args(Alignment))
            raise InputError(f"{ALIGNMENT_FLAG} is {value[:60]!r}: give NAME=ALIGNMENT with one of {kinds}")
        if name not in options:
            raise InputError(f"{ALIGNMENT_FLAG} is for {name[:40]!r}, which no {FLAG} names: give the name of one")
        options[name] = replace(options[name], alignment=kind)  # type: ignore[arg-type]
    return tuple(options.values())


def _named(value: str) -> tuple[str, FrameOfFile, Path]:
    whose, equals, path = value.partition("=")
    name, colon, frame = whose.partition(":")
    frame = frame if colon else "rig"
    if not equals or not path or frame not in get_args(FrameOfFile):
        frames = ", ".join(get_args(FrameOfFile))
        raise InputError(f"{FLAG} is {value[:60]!r}: give NAME=FILE, or NAME:FRAME=FILE with one of {frames}")
    if not _NAME.fullmatch(name):
        raise InputError(f"{FLAG} names a trajectory {name[:60]!r}: use letters, digits, - and _, a letter first")
    return name, frame, Path(path)  # type: ignore[return-value]


WIDEST_GAP = 3.0
"""Median intervals between two poses beyond which nothing is interpolated between them."""


@dataclass(frozen=True, eq=False)
class Placed:
    """The trajectory of another program, aligned to the shared world."""

    poses: Trajectory
    """shared_world_from_rig at the file's own times."""
    alignment: str
    """How it was aligned, in words."""
    positions: Array
    """(N, 3) at the frames, interpolated; NaN where the file has no poses on both sides, near enough."""
    rotations: Array
    """(N, 3, 3) likewise."""
    errors_m: Array
    """(N,) distance of the rig from the truth at the frames; NaN where one of them is unknown."""

    def pose(self, index: int) -> Pose | None:
        """shared_world_from_rig at a frame, where it is known."""
        if not np.isfinite(self.positions[index]).all():
            return None
        return Pose(self.rotations[index], self.positions[index])

    def count(self, time_ns: int) -> int:
        """The number of the file's poses up to a time."""
        return int(np.searchsorted(self.poses.times_ns, time_ns, side="right"))

    def missing(self, count: int) -> int:
        """The number of the first `count` frames without a pose."""
        return int(np.isnan(self.positions[:count, 0]).sum())


@dataclass(frozen=True, eq=False)
class ExternalTrajectory:
    """A trajectory of another program over the sequence of a run."""

    option: TrajectoryOption
    number: int
    """Its index among the options."""
    times_ns: NDArray[np.int64]
    """(N,) of the frames."""
    trajectory: Trajectory
    """world_from_frame, in its own world and unit."""
    of_truth: Placed | None
    """Aligned to the ground truth; None without one."""

    @property
    def name(self) -> str:
        return self.option.name

    @property
    def colour(self) -> Rgb:
        return colour_of_external(self.number)

    @cached_property
    def errors_m(self) -> Array:
        """(N,) at the frames; NaN where unknown."""
        return np.full(len(self.times_ns), np.nan) if self.of_truth is None else self.of_truth.errors_m

    def error(self, truth: Trajectory, rig: Rig, until_ns: int) -> TrajectoryError | None:
        """Against shared_world_from_rig of the ground truth, up to a time; None with too few common times."""
        known = self.trajectory.select(self.trajectory.times_ns <= until_ns)
        return error_against_truth(known, truth, rig, self.option.alignment)

    def placed(self, reference: Trajectory, against: str, rig: Rig, kind: Alignment | None = None) -> Placed | None:
        """Aligned to shared_world_from_rig of the reference (called `against`); None with too few common times."""
        kind = kind or self.option.alignment
        frame = self.option.frame
        partner = reference.moved(right=rig.rig_from(frame), frame=frame)
        own, other = associate(self.trajectory, partner)
        if len(own) < (MIN_POSES if kind in ("scale", "se3", "sim3") else 1):
            return None
        found = alignment(own, other, kind)
        poses = placed(self.trajectory, found).moved(right=rig.rig_from(frame).inverse(), frame="rig")
        positions, rotations = _at(poses, self.times_ns)
        of_frame = "" if frame == "rig" else f"poses of the {frame} camera, "
        scale = f", scale {found.scale:.4g}" if kind in ("scale", "sim3") else ""
        words = f"{of_frame}aligned to {against} by {ALIGNMENTS[kind]} ({len(own)} poses{scale})"
        return Placed(poses, words, positions, rotations, _errors_m(positions, self.times_ns, reference))


def external_trajectory(
    number: int, option: TrajectoryOption, sequence: Sequence, truth: Trajectory | None
) -> ExternalTrajectory:
    """Returns the trajectory at the frames of a sequence. `truth` is shared_world_from_rig.

    Raises InputError without common times."""
    if sequence.grow is not None:
        raise InputError(f"{FLAG} {option.name}: {sequence.name} is live: record it first, and open the recording")
    if option.frame != "rig" and getattr(sequence.rig, option.frame) is None:
        raise InputError(
            f"{FLAG} {option.name}:{option.frame}: nothing is known of a {option.frame} camera in {sequence.name}: "
            "give poses of the rig"
        )
    trajectory, path = _timed(option, sequence), option.file.path
    trajectory = replace(trajectory, frame=option.frame)
    external = ExternalTrajectory(option, number, sequence.times_ns, trajectory, None)
    if not np.isfinite(_at(trajectory, sequence.times_ns)[0]).any():
        raise InputError(
            f"{FLAG} {option.name}: the times of {path} have none in common with those of {sequence.name}: "
            "give a trajectory of the same recording, with its times in seconds"
        )
    if truth is None:
        return external
    against = external.placed(truth, "the ground truth", sequence.rig)
    if against is None:
        raise InputError(
            f"{FLAG} {option.name}: {path} has fewer than {MIN_POSES} poses within 10 ms of one of the ground truth: "
            "give a trajectory of the same recording"
        )
    return replace(external, of_truth=against)


def _timed(option: TrajectoryOption, sequence: Sequence) -> Trajectory:
    """Returns the trajectory with times. Where the file has none, as those of KITTI, row i has the time of image i."""
    trajectory = option.file.trajectory
    if option.file.timed:
        # Of several poses at one time the last counts.
        times_ns, last = np.unique(trajectory.times_ns[::-1], return_index=True)
        return replace(trajectory.select(len(trajectory) - 1 - last), times_ns=times_ns)
    kinds = np.array(sequence.kinds)
    numbers = trajectory.times_ns // ROW_NS
    for times_ns in (sequence.times_ns, *(sequence.times_ns[kinds == kind] for kind in ("video", "stereo"))):
        images_ns = np.unique(times_ns)
        if len(images_ns) == len(trajectory):
            return replace(trajectory, times_ns=images_ns)
        if option.file.numbered and len(numbers) and numbers[-1] == len(images_ns) - 1:
            return replace(trajectory, times_ns=images_ns[numbers])
    raise InputError(
        f"{FLAG} {option.name}: {option.file.path} has {len(trajectory)} rows without times, and {sequence.name} "
        f"{len(np.unique(sequence.times_ns))} images: give a file with a row for each image, or one with times (TUM)"
    )


def _at(poses: Trajectory, times_ns: NDArray[np.int64]) -> tuple[Array, Array]:
    """Positions (N, 3) and rotations (N, 3, 3) at times; NaN outside, and in gaps."""
    positions, rotations = np.full((len(times_ns), 3), np.nan), np.full((len(times_ns), 3, 3), np.nan)
    own = poses.times_ns
    after = np.searchsorted(own, times_ns).clip(0, len(own) - 1)
    before = np.where(own[after] == times_ns, after, (after - 1).clip(0))
    widest_ns = WIDEST_GAP * float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    known = (own[before] <= times_ns) & (times_ns <= own[after]) & (own[after] - own[before] <= widest_ns)
    if known.any():
        found = interpolate(poses, times_ns[known], "linear")
        positions[known], rotations[known] = found.translations, found.rotations
    return positions, rotations


def _errors_m(positions: Array, times_ns: NDArray[np.int64], truth: Trajectory) -> Array:
    """(N,) distances from the truth at exactly these times."""
    at = np.searchsorted(truth.times_ns, times_ns).clip(0, len(truth) - 1)
    errors = np.linalg.norm(positions - truth.translations[at], axis=1)
    return np.where(truth.times_ns[at] == times_ns, errors, np.nan)
