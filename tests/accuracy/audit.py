"""`python -m tests.accuracy audit`: what `ispom evaluate` says of mistakes that are planted in right pairs.

Pairs are trajectories of other programs with their truth (below --data), and simulated motions with the errors of an
odometry. Each kind of mistake is planted in each pair where it can be made; the right pairs must be silent.
`python -m tests.accuracy.audit '{...}'` prints what was found in one pair as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.evaluation.audit.auditor import Question, audit
from ispom.evaluation.audit.correction import Correction, undone
from ispom.evaluation.trajectory_error import Alignment, associate
from ispom.geometry import Pose, so3_exp
from ispom.io.poses.recognised import read_trajectory
from ispom.simulation.motions import motion_of
from ispom.types import Trajectory

from .page import write_between

REAL: Mapping[str, tuple[str, str, Alignment]] = {
    "KITTI 00, ORB-SLAM2": ("KITTI_00_gt.txt", "KITTI_00_ORB.txt", "se3"),
    "KITTI 00, S-PTAM": ("KITTI_00_gt.txt", "KITTI_00_SPTAM.txt", "se3"),
    "EuRoC V1_02": ("V102_groundtruth.csv", "V102.txt", "se3"),
    "TUM fr2/desk, ORB-SLAM2": ("fr2_desk_groundtruth.txt", "fr2_desk_ORB.txt", "se3"),
    "TUM fr2/desk, keyframes": ("fr2_desk_groundtruth.txt", "fr2_desk_ORB_kf_mono.txt", "sim3"),
    "TUM fr1/xyz, RGB-D SLAM": ("freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt", "se3"),
}
"""Reference, estimate, and alignment, by name."""
OWN_SHIFT = {"KITTI 00, S-PTAM": 1}
"""Rows by which a file is shifted as it comes: with it the RPE of its rotations falls from 0.30 to 0.115 deg, which is
what the other program has. It is corrected before anything is planted."""
SIMULATED = tuple(f"sim:{motion} {seed}" for motion in ("flight", "loop", "walk", "drive") for seed in range(4))
SECONDS, TRUE_HZ, OWN_HZ = 60.0, 100.0, 20.0
"""Length of a simulated pair, and the rates of its trajectories."""
STEP_NOISE, TURN_NOISE_DEG, JITTER_M, JITTER_DEG = 0.01, 0.02, 0.003, 0.1
"""Errors of the simulated odometry: of each step, relative to it; of each turn; and of each pose."""
SCALE_ERROR = 0.01
"""Largest error of its scale."""


@dataclass(frozen=True)
class Pair:
    name: str
    question: Question

    @property
    def metric(self) -> bool:
        return not self.question.with_scale


@dataclass(frozen=True)
class Plant:
    """A mistake that is made in an estimate."""

    name: str
    kind: str
    key: str
    """Of the finding that names it."""
    applied: Callable[[Trajectory], Trajectory]
    value: float = 0.0
    """Of a clock: the offset [s] that corrects it."""


@dataclass(frozen=True)
class Found:
    pair: str
    plant: str
    """"" for a right pair."""
    kind: str
    first: str
    """Key of the first finding; "" where there is none."""
    right: bool
    cannot_tell: bool = False
    """Whether the right answer is one of those between which the audit cannot tell, but not the first of them."""
    offset_error_s: float | None = None


def pair_of(name: str, data: Path) -> Pair:
    """Raises KeyError for a name that is none."""
    return Pair(name, _simulated(name) if name.startswith("sim:") else _real(name, data))


def pairs_in(data: Path) -> list[str]:
    """Names of the pairs whose files are there."""
    there = [name for name, (a, b, _) in REAL.items() if all((data / "trajectories" / f).is_file() for f in (a, b))]
    return [*there, *SIMULATED]


def _question(
    estimate: Trajectory, reference: Trajectory, alignment: Alignment, timed: bool, rotations: tuple[bool, bool]
) -> Question:
    def associated(own: Trajectory, other: Trajectory, most_s: float | None) -> tuple[Trajectory, Trajectory]:
        return associate(own, other, round((0.01 if most_s is None else most_s) * 1e9) if timed else 0)

    return Question(estimate, reference, associated, alignment, timed, rotations=rotations)


def _real(name: str, data: Path) -> Question:
    reference, estimate, alignment = REAL[name]
    true, own = (read_trajectory(data / "trajectories" / file) for file in (reference, estimate))
    shifted = Correction(offset_s=OWN_SHIFT.get(name, 0)).of_estimate(own.trajectory)
    has = own.has_rotations, true.has_rotations
    return _question(shifted, true.trajectory, alignment, own.timed, has)


def _simulated(name: str) -> Question:
    """Every second pair is of a method without metric scale, which drifts."""
    motion, seed = name.removeprefix("sim:").split()
    times = np.round(np.arange(0, SECONDS, 1 / TRUE_HZ) * 1e9).astype(np.int64)
    path = motion_of(motion, int(seed))
    true = Trajectory.of([(int(t), path.pose_at(int(t))) for t in times])
    own = estimated(true.select(slice(None, None, round(TRUE_HZ / OWN_HZ))), int(seed))
    if int(seed) % 2 == 0:
        return _question(own, true, "se3", True, (True, True))
    drift = np.exp(np.linspace(0, 0.1, len(own)))[:, None]
    own = replace(own, translations=np.cumsum(np.diff(own.translations, axis=0, prepend=0) * drift / 3, axis=0))
    return _question(own, true, "sim3", True, (True, True))


def estimated(true: Trajectory, seed: int) -> Trajectory:
    """Returns a trajectory with the errors of an odometry, in a world of its own."""
    rng = np.random.default_rng([seed, 7])
    back = np.swapaxes(true.rotations[:-1], 1, 2)
    turns = back @ true.rotations[1:] @ so3_exp(np.radians(TURN_NOISE_DEG) * rng.normal(size=(len(true) - 1, 3)))
    steps = np.einsum("nij,nj->ni", back, np.diff(true.translations, axis=0))
    size = np.linalg.norm(steps, axis=1, keepdims=True)
    steps = steps * (1 + SCALE_ERROR * rng.uniform(-1, 1)) + STEP_NOISE * size * rng.normal(size=steps.shape)
    rotations, positions = [np.eye(3)], [np.zeros(3)]
    for turn, step in zip(turns, steps, strict=True):
        positions.append(positions[-1] + rotations[-1] @ step)
        rotations.append(rotations[-1] @ turn)
    shaken = np.array(rotations) @ so3_exp(np.radians(JITTER_DEG) * rng.normal(size=(len(true), 3)))
    return Trajectory(true.times_ns, shaken, np.array(positions) + JITTER_M * rng.normal(size=(len(true), 3)))


OPENGL, ROS = np.diag([1.0, -1, -1]), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def plants(pair: Pair) -> Iterator[Plant]:
    """Yields the mistakes that can be made in a pair."""
    timed = pair.question.timed
    for value in (0.25, -0.1, 0.05, 1.3) if timed else ():
        yield Plant(f"clock {value:+g} s", "clock", "offset", _shifted(value), -value)
    for value in () if timed else (1.0, -3.0, 20.0):
        yield Plant(f"index {value:+g}", "index", "offset", _shifted(value), -value)
    for name, turn in (("OpenGL", OPENGL), ("ROS", ROS), ("from ROS", ROS.T)):
        yield Plant(f"axes {name}", "axes", "axes", _moved(turn, np.zeros(3)))
    yield Plant("inverse", "inverse", "inverse", lambda t: undone(t, ("inverse",)))
    yield Plant("w first", "quaternion order", "w-first", lambda t: undone(t, ("w-last",)))
    unit = 1.0 if pair.metric else _unit(pair)
    for arm in ((0.3, 0.0, 0.0), (0.0, 0.1, -0.28), (0.2, -0.2, 0.1)):
        yield Plant(f"lever arm {arm}", "lever arm", "lever_arm", _moved(np.eye(3), np.array(arm) / unit))
    for factor in (0.13, 1.3, 0.8) if pair.metric else ():
        yield Plant(f"scale {factor}", "scale", "scale", _scaled(factor))
    if pair.metric:
        yield Plant("millimetres", "unit", "scale", _scaled(1000.0))
    for axis in ("mirrored-x", "mirrored-y", "mirrored-z"):
        yield Plant(axis, "mirrored", "mirrored", lambda t, axis=axis: undone(t, (axis,)))


def _unit(pair: Pair) -> float:
    """Metres per unit of the estimate."""
    own, true = pair.question.pairs(Correction())
    return float(np.linalg.norm(np.std(true.translations, axis=0)) / np.linalg.norm(np.std(own.translations, axis=0)))


def _shifted(seconds: float) -> Callable[[Trajectory], Trajectory]:
    return lambda t: replace(t, times_ns=t.times_ns + round(seconds * 1e9))


def _scaled(factor: float) -> Callable[[Trajectory], Trajectory]:
    return lambda t: replace(t, translations=factor * t.translations)


def _moved(turn: np.ndarray, arm: np.ndarray) -> Callable[[Trajectory], Trajectory]:
    return lambda t: t.moved(right=Pose(turn, arm))


def tried(pair: Pair) -> Iterator[Found]:
    """The right pair, and each mistake in it."""
    findings = audit(pair.question)
    yield Found(pair.name, "", "right pair", findings[0].key if findings else "", not findings)
    alone = {f.key: f.values for f in findings}
    for plant in plants(pair):
        question = replace(pair.question, estimate=plant.applied(pair.question.estimate))
        if _same(question, pair.question):
            continue  # such as the mirror of a path in its plane
        findings = audit(question)
        first = findings[0] if findings else None
        error = None
        if first is not None and first.key == plant.key == "offset":
            # Clocks of real pairs differ by some milliseconds as they are: what was planted is the difference.
            error = first.values["offset_s"] - plant.value - alone.get("offset", {}).get("offset_s", 0.0)
        right = first is not None and first.key == plant.key
        undecided = first is not None and not right and plant.key in first.rivals
        yield Found(pair.name, plant.name, plant.kind, first.key if first else "", right, undecided, error)


def _same(a: Question, b: Question) -> bool:
    """Checks that all errors are the same: nothing can be noticed."""
    both = [[v or 0.0 for v in q.measures(Correction()).values()] for q in (a, b)]
    return len(both[0]) == len(both[1]) and np.allclose(*both, rtol=1e-6, atol=1e-9)


def print_audit(console: Console, found: list[Found]) -> None:
    """The summary by kind of mistake, and what went wrong."""
    table = Table("planted", "named first", "cannot tell", "largest error of the clock", box=None)
    for kind in dict.fromkeys(f.kind for f in found if f.plant):
        of_kind = [f for f in found if f.kind == kind]
        errors = [abs(f.offset_error_s) for f in of_kind if f.offset_error_s is not None]
        worst = f"{1e3 * max(errors):.1f} ms" if errors and kind == "clock" else ""
        table.add_row(
            kind, f"{sum(f.right for f in of_kind)} of {len(of_kind)}", str(sum(f.cannot_tell for f in of_kind)), worst
        )
    console.print(table)
    planted, right = [f for f in found if f.plant], [f for f in found if not f.plant]
    undecided = sum(f.cannot_tell for f in planted)
    alarms = [f.pair for f in right if not f.right]
    console.print(
        f"named first: {sum(f.right for f in planted)} of {len(planted)}, and in {undecided} it cannot tell which of "
        f"several; false alarms: {len(alarms)} of {len(right)} right pairs"
    )
    for f in found:
        if not f.right:
            words = ", cannot tell it from what was planted" if f.cannot_tell else ""
            console.print(f"! {f.pair}: {f.plant or 'right pair'}: {f.first or 'nothing found'}{words}")


def write_audits(page: Path, found: list[Found]) -> None:
    """Replaces the table of a page of the documentation."""
    write_between(page, "audit", markdown(found))


def markdown(found: list[Found]) -> str:
    """How often each kind of mistake is named first, by pairs of other programs and simulated ones; and the misses."""
    planted, groups = [f for f in found if f.plant], (False, True)
    lines = ["| planted | named first, real pairs | named first, simulated | cannot tell | clock |", "| --- " * 5 + "|"]
    for kind in dict.fromkeys(f.kind for f in planted):
        cells = []
        for simulated in groups:
            some = [f for f in planted if f.kind == kind and f.pair.startswith("sim:") == simulated]
            cells.append(f"{sum(f.right for f in some)} of {len(some)}" if some else "")
        undecided = sum(f.cannot_tell for f in planted if f.kind == kind)
        errors = [abs(f.offset_error_s) for f in planted if f.kind == kind == "clock" and f.offset_error_s is not None]
        worst = f"within {1e3 * max(errors):.1f} ms" if errors else ""
        lines.append(f"| {kind} | {cells[0]} | {cells[1]} | {undecided or ''} | {worst} |")
    right = [f for f in found if not f.plant]
    share = 100 * sum(f.right for f in planted) / max(len(planted), 1)
    lines += [
        "",
        f"Named first: {sum(f.right for f in planted)} of {len(planted)} ({share:.1f} %). Right pairs with a false "
        f"alarm: {sum(not f.right for f in right)} of {len(right)}.",
        "",
    ]
    for f in found:
        if not f.right:
            words = "; it says that it cannot tell them apart" if f.cannot_tell else ""
            lines.append(f"- {f.pair}, {f.plant or 'the right pair'}: {f.first or 'no finding'}{words}")
    return "\n".join(lines).rstrip()


def audits_found(rows: list[dict[str, Any]]) -> list[Found]:
    """What a process printed."""
    return [Found(**row) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    pair = pair_of(task["pair"], Path(task["data"]))
    sys.stdout.write(json.dumps([asdict(f) for f in tried(pair)]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
