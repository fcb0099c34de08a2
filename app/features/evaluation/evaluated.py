"""What was compared with the reference, and the names that distinguish several."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ispom.errors import InputError, counted
from ispom.evaluation.comparison import AT_REST_M, Comparison, Delta, Motion, measures
from ispom.evaluation.trajectory_error import Alignment
from ispom.geometry import rotation_angle_rad
from ispom.io.poses.dialect import TrajectoryFile
from ispom.types import Trajectory

from ...engine.run_folder.run_file import read_run_file
from ...presentation.texts import ALIGNMENTS
from .audit import Audit
from .options import Evaluate
from .values import delta_of


def frame_of(file: TrajectoryFile) -> str | None:
    """Whose poses a file holds, where known: EuRoC's truth is of the body; `ispom run` writes it next to the file."""
    if file.format == "EuRoC":
        return "body"
    try:
        return read_run_file(file.path.parent).frame
    except InputError:
        return None


def protocol_of(reference: TrajectoryFile, files: list[TrajectoryFile], options: Evaluate) -> dict[str, str]:
    """What must be known to read the numbers rightly."""
    frames = {str(file.path): frame_of(file) for file in (reference, *files)}
    known = {frame for frame in frames.values() if frame}
    frame = ", ".join(f"{path}: {frame or 'unknown'}" for path, frame in frames.items())
    warning = " (different frames: the lever arm between them counts as error)" if len(known) > 1 else ""
    row = "row by row, or by the names or numbers of images: these files have no times"
    time = f"each pose of the shorter file with the nearest in time, at most {options.max_difference_s:g} s away"
    poses, path_m = len(reference.trajectory), reference.trajectory.length
    seconds = (reference.trajectory.times_ns[-1] - reference.trajectory.times_ns[0]) * 1e-9
    span = f" over {seconds:.1f} s" if reference.timed else ""
    return {
        "reference": f"{reference.path} ({_kind(reference)}, {poses} poses, {path_m:.1f} m{span})",
        "estimates": ", ".join(f"{f.path} ({_kind(f)}, {len(f.trajectory)} poses)" for f in files),
        "frames": f"poses are compared as the files have them{warning}; {frame}",
        "association": time if reference.timed else row,
        "alignment": ALIGNMENTS[options.alignment] + _fitted_to(options),
        "corrections": _corrections(options),
        "RPE": _motions(delta_of(options.delta)),
        "KITTI": "mean over 100 to 800 m from every tenth pose; below 200 m over 5 to 40 m from every pose",
        "local scale": "path in the estimate, before alignment, over path in the reference, in ten windows along it",
    }


def _fitted_to(options: Evaluate) -> str:
    return "" if options.align_first is None else f"; only over the first {options.align_first}"


def _corrections(options: Evaluate) -> str:
    """What the options do to the trajectories before they are compared."""
    words = [
        f"times of the estimates x {options.clock_rate:g}" if options.clock_rate != 1 else "",
        f"{options.offset:+g} s on the times of the estimates" if options.offset else "",
        f"estimates read as {', '.join(options.conventions)}" if options.conventions else "",
        f"reference read as {', '.join(options.reference_conventions)}" if options.reference_conventions else "",
        "estimates moved to the reference's body" if options.body == "auto" else "",
        f"without {', '.join(options.exclude)} s" if options.exclude else "",
        "positions only" if options.positions_only else "",
    ]
    return "; ".join(filter(None, words)) or "none"


def _motions(delta: Delta) -> str:
    if delta.unit == "poses":
        return f"over all pairs of compared poses i, i + {delta}"
    way = "of the reference's path" if delta.unit == "m" else "of time"
    return f"over motions of {delta.value:g} {delta.unit} {way}, from each compared pose"


def _kind(file: TrajectoryFile) -> str:
    """The format, and the unit of times that the file does not say itself."""
    return f"{file.format} with times in {file.unit}" if file.unit else file.format


FROM_POSITIONS = ("se3", "sim3")
"""Alignments that find a rotation from positions."""
_FIRST = "--alignment first takes it from the first pose"
MOTIONS: Mapping[Motion, str] = {
    "rests": "the reference rests, without translation or rotation: its positions fix no alignment, and ATE says "
    f"nothing of a motion; {_FIRST}",
    "turns": "the reference only turns, without translation: its positions fix no alignment, and the rotation of ATE "
    f"means nothing; {_FIRST}",
    "straight": "the compared path is nearly straight: the alignment hardly fixes the rotation about it, on which the "
    f"rotation of ATE depends; {_FIRST}",
}
"""What to know of an alignment by positions, where the reference moves so."""


OF_BODY = ("rpe_", "kitti_")
"""Beginnings of the names of errors in the body, which depend on rotations."""
SAME_DEG, TURNS_DEG = 1e-4, 5.0
"""Rotations that differ by no more are one; and what a body that turns does at least."""


Pairs = tuple[Trajectory, Trajectory]


def kind_has_scale(found: Comparison) -> bool:
    """Checks that the alignment fits a scale."""
    return found.error.alignment in ("scale", "sim3")


def largest_turn_deg(poses: Trajectory) -> float:
    """Returns the largest angle between the first pose and another one [deg]."""
    return float(np.degrees(rotation_angle_rad(poses.rotations[0].T @ poses.rotations).max()))


def constant_rotation(own: Trajectory, other: Trajectory) -> bool:
    """Checks that a path has one rotation, and another one of the same body does not: it has positions only."""
    same = len(own) and len(other) and largest_turn_deg(own) <= SAME_DEG
    return bool(same and largest_turn_deg(other) > TURNS_DEG and not rests(own))


def rests(poses: Trajectory) -> bool:
    """Checks that all positions are one."""
    return float(np.ptp(poses.translations, axis=0).max()) <= AT_REST_M


def pairs_by_name(file: TrajectoryFile, reference: TrajectoryFile) -> tuple[Trajectory, Trajectory] | None:
    """Returns the poses of both that are of images with one name, folders aside; None where a file has no names, or
    the same one twice."""
    names = [[re.split(r"[/\\]", image)[-1] for image in each.images] for each in (file, reference)]
    if not all(names) or any(len(set(each)) < len(each) for each in names):
        return None
    places = [{name: i for i, name in enumerate(each)} for each in names]
    both = [name for name in names[1] if name in places[0]]
    own, other = (np.array([place[name] for name in both], np.int64) for place in places)
    partners = reference.trajectory.select(other)
    return replace(file.trajectory.select(own), times_ns=partners.times_ns), partners


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One estimate, by a name that no other has."""

    name: str
    file: TrajectoryFile
    found: Comparison
    reference: TrajectoryFile
    body: str = ""
    """What was done to the estimate's poses for them to be of the reference's body."""

    @property
    def rpe_interval_s(self) -> float | None:
        """Median time of the motions of RPE; None where only rows are known, and without motions."""
        first, last = self.found.delta.motions(self.found.reference)
        if not self.file.timed or not len(first):
            return None
        times_ns = self.found.reference.times_ns
        return float(np.median(times_ns[last] - times_ns[first])) * 1e-9

    @property
    def without_rotations(self) -> str:
        """Why rotations are not compared; "" where they are."""
        for file in (self.reference, self.file):
            if not file.has_rotations:
                return f"{file.path} has positions only"
        for path, own, other in (
            (self.reference.path, self.found.reference, self.found.estimate),
            (self.file.path, self.found.estimate, self.found.reference),
        ):
            if constant_rotation(own, other):
                turn = f"the other one turns by {largest_turn_deg(other):.0f} deg"
                return f"{path} has one and the same rotation in all poses, and {turn}"
        return ""

    @property
    def measures(self) -> dict[str, float | None]:
        """Without a gap in seconds where only rows are known."""
        values = measures(self.found)
        if self.without_rotations:
            values = {k: None if k.endswith("_deg") or k.startswith(OF_BODY) else v for k, v in values.items()}
        if kind_has_scale(self.found) and rests(self.found.estimate) != rests(self.found.reference):
            values = values | {"alignment_scale": None}
        return values if self.file.timed else values | {"longest_gap_s": None}

    def notes(self, kind: Alignment) -> list[str]:
        """What keeps the numbers from meaning what they seem to."""
        found = repeated_note(self.name, self.file)
        found += [f"{self.name}: {self.body}"] if self.body else []
        if reason := self.without_rotations:
            found.append(
                f"{self.name}: no errors of rotations, and none in the body (RPE, KITTI), which need them: {reason}"
            )
        if rests(self.found.estimate) and not rests(self.found.reference):
            found.append(f"{self.name}: it does not move, and the reference does: ATE is that of a body at rest")
        if kind in FROM_POSITIONS and self.found.motion in MOTIONS:
            found.append(f"{self.name}: {MOTIONS[self.found.motion]}")
        return found


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Estimates that were compared with one reference."""

    reference: TrajectoryFile
    protocol: dict[str, str]
    items: list[Evaluated]
    notes: list[str]
    audits: list[Audit] | None
    """Of the same estimates; None where none was asked for."""


def repeated_note(name: str, file: TrajectoryFile) -> list[str]:
    """How many poses of a file have the time of another one; nothing where none has."""
    count = len(file.trajectory)
    repeated = count - len(np.unique(file.trajectory.times_ns))
    what = counted(repeated, "pose has", "poses have")
    return [f"{name}: {what} the time of another one, of {count}; each is compared by itself"] if repeated else []


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """The file names, with as many of their folders as make all of them different."""
    for depth in range(1, max(len(p.parts) for p in paths) + 1):
        names = ["/".join(p.parts[-depth:]) for p in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{i}: {p}" for i, p in enumerate(paths, 1)]
