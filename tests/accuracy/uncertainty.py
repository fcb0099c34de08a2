"""`python -m tests.accuracy uncertainty`: whether covariances agree with errors, of every method that states them.

Each method runs on what its sensors are simulated for: on the flights of `consistency` with exact cameras, on a drive
with all sensors (`fused` and its kin, by scheme of Table 2), or on a scene of its own.
`python -m tests.accuracy.uncertainty '{...}'` prints what was found of one seed as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.estimators.survey.fused_settings import FusedSettings
from ispom.evaluation.trajectory_error import error_against_truth
from ispom.geometry import Array, Pose, so3_exp
from ispom.methods import Config, names
from ispom.methods import method as registered
from ispom.sensors.gnss import SimulatedGnss
from ispom.sequences import open_sequence
from ispom.types import Kind, Sequence, Step, Trajectory
from ispom.types.rig import POSE_PREFIX
from tests.alone import OF_CAMERAS, OWN_SEQUENCES
from tests.nees import Errors

from .consistency import FLIGHTS, errors_of_run, flown

FILE = Path(__file__).with_name("uncertainty.json")
DRIVE = "sim:tiny?motion=drive&duration_s=12&sensor=imu&sensor=wheel&sensor=gnss&sensor=laser"
SCHEMES = {"fused": "2345678", "fused.stereo": "2345678", "fused.tight": "246"}
"""Of Table 2: 1 is 2 with a better IMU, and 9 is the visual method alone."""
START_M = 5.0
OPTICAL_FROM_LOCAL = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
RIGHT = (4.0, 9.0)
"""Mean NEES of a pose that is right: 6, as far as five seeds tell."""
CAUSES: Mapping[tuple[str, str], str] = {
    ("monocular", "sim:tiny"): "these five seeds: the next fifteen have 5.4, all twenty 6.6",
}
"""Why a row is outside, by method, and scheme or source."""


@dataclass(frozen=True)
class Stated:
    """What one method stated on one source."""

    method: str
    scheme: str
    """Of Table 2; empty for a method without any."""
    source: str
    seed: int
    nees: float | None
    """Mean over the poses; None where the method states no covariance."""
    ate_m: float | None = None
    """Of the whole path, of methods with schemes [m]."""


def sources_of(method: str) -> dict[str, Callable[[int, Path], Sequence]]:
    """Returns what a method without schemes is measured on, by title: of a seed and a folder for what is rendered."""
    if method in OWN_SEQUENCES:
        return {"its own scene": lambda seed, folder: OWN_SEQUENCES[method]()}
    if method in OF_CAMERAS:
        return {"sim:ring5": lambda seed, folder: open_sequence(f"sim:ring5?duration_s=6&seed={seed}")}
    return {scene: partial(flown, scene) for scene in FLIGHTS}


def stated(method: str, seed: int, folder: Path) -> list[Stated]:
    """Returns what a method without schemes stated, by source; one row without a number where it states nothing."""
    rows = list[Stated]()
    for source, opened in sources_of(method).items():
        errors = errors_of_run(opened(seed, folder), method)
        nees = float(errors.nees().mean()) if len(errors.times_ns) else None
        rows.append(Stated(method, "", source, seed, nees))
        if nees is None:
            break
    return rows


def tilted(sequence: Sequence, seed: int) -> Sequence:
    """Returns a sequence whose rig stands off level at the start by what `tilt_deg` allows for, each seed otherwise.

    The frame of the rig is turned in the vehicle, so that all measurements stay as they are.
    """
    sigma = np.radians(FusedSettings().tilt_deg)
    about_x, about_z = np.random.default_rng(2000 + seed).normal(0, sigma, 2)
    turn, rig = Pose(so3_exp(np.array([about_x, 0.0, about_z]))), sequence.rig
    poses = {f"{POSE_PREFIX}{name}": turn.inverse() @ each.rig_from_sensor for name, each in rig.sensors.items()}
    truth = None if sequence.truth is None else sequence.truth.moved(right=turn)
    return replace(sequence, rig=rig.changed(**poses), truth=truth)


def stated_on_drive(method: str, seed: int) -> list[Stated]:
    """Returns what a method with schemes stated, by scheme."""
    sequence = tilted(open_sequence(f"{DRIVE}&seed={seed}"), seed)
    assert sequence.truth is not None
    seen = _seen(sequence, registered(method).asks["visual"])
    rows = list[Stated]()
    for scheme in SCHEMES[method]:
        steps, path = _played(method, scheme, sequence, seen)
        error = error_against_truth(path, sequence.truth, sequence.rig, "se3")
        nees = float(errors_in_gauge(scheme, steps, path, sequence.truth).nees().mean())
        rows.append(Stated(method, scheme, "a drive with all sensors", seed, nees, error and error.ate_m))
    return rows


@dataclass(frozen=True, eq=False)
class Seen:
    """What a visual method made of a drive."""

    kind: Kind
    steps: Mapping[int, Step]
    """By number of the measurement."""
    final: Trajectory


def _seen(sequence: Sequence, method: str) -> Seen:
    """Runs the visual method, once for all schemes."""
    ensemble, steps = build(Config(), (method,), sequence.rig), dict[int, Step]()
    state, (kind,) = ensemble.start(), registered(method).sensors
    for i in (i for i, k in enumerate(sequence.kinds) if k == kind):
        state, (steps[i],) = ensemble.step(state, sequence[i])
    return Seen(kind, steps, ensemble.finish(state)[method])


def _played(method: str, scheme: Any, sequence: Sequence, seen: Seen) -> tuple[list[Step], Trajectory]:
    """Returns the steps at images and the final path."""
    estimator = registered(method).config(scheme=scheme, start_m=START_M).build(sequence.rig)
    state, steps = estimator.start(), list[Step]()
    for i, kind in enumerate(sequence.kinds):
        if kind in registered(method).sensors:
            state, step = estimator.step(state, sequence[i], {"visual": seen.steps[i]} if i in seen.steps else {})
            steps += [step] if i in seen.steps else []
    return steps, estimator.finish(state, {"visual": seen.final})


def errors_in_gauge(scheme: str, steps: list[Step], path: Trajectory, truth: Trajectory) -> Errors:
    """Returns the errors in the gauge in which the scheme estimates: that of the fixes; else with the first pose as
    origin, and with an IMU with its heading, as up is measured. Steps of an earlier segment are in another world."""
    at, first = next(iter(path.items()))
    true = truth.at(at)
    assert true is not None
    world_from_truth = first @ true.inverse()
    if scheme in "234":
        world_from_truth = Pose(OPTICAL_FROM_LOCAL @ SimulatedGnss().local_from_world)
    elif scheme in "56":
        world_from_truth = _level(world_from_truth.rotation, true.translation, first.translation)
    times, twists, covariances = [], [], []
    begun = max((i for i, step in enumerate(steps) if step.restarted), default=0)
    for step in steps[begun:]:
        seen = truth.at(step.time_ns)
        if step.world_from_frame is not None and step.covariance is not None and step.time_ns > at and seen is not None:
            times.append(step.time_ns)
            twists.append((step.world_from_frame.inverse() @ world_from_truth @ seen).log())
            covariances.append(step.covariance)
    return Errors(np.array(times, np.int64), np.array(twists), np.array(covariances))


def _level(rotation: Array, origin: Array, onto: Array) -> Pose:
    """Returns the pose that turns about the vertical (y) as a rotation does, and moves `origin` onto another place."""
    heading = np.arctan2(rotation[0, 2] - rotation[2, 0], rotation[0, 0] + rotation[2, 2])
    turn = so3_exp(np.array([0.0, heading, 0.0]))
    return Pose(turn, onto - turn @ origin)


def found_of(task: dict[str, Any]) -> list[Stated]:
    """Returns the rows of one method and seed."""
    method, seed = task["method"], task["seed"]
    return stated_on_drive(method, seed) if method in SCHEMES else stated(method, seed, Path(task["folder"]))


# The table


@dataclass(frozen=True)
class Mean:
    """What one method stated on one source over all seeds."""

    scheme: str
    source: str
    nees: tuple[float, ...]
    """(S,) of each seed, to one decimal."""
    ate_m: float | None = None
    """Mean [m]."""

    @property
    def mean(self) -> float:
        return float(np.mean(self.nees))

    @property
    def right(self) -> bool:
        return RIGHT[0] <= self.mean <= RIGHT[1]


Table = dict[str, list[Mean]]
"""By method; nothing of methods that state no covariance."""


def means(rows: Iterable[Stated]) -> list[Mean]:
    """Averages the rows of one method over the seeds."""
    by = dict[tuple[str, str], list[Stated]]()
    for row in rows:
        if row.nees is not None:
            by.setdefault((row.scheme, row.source), []).append(row)
    found = list[Mean]()
    for (scheme, source), same in by.items():
        ate = [row.ate_m for row in same if row.ate_m is not None]
        nees = tuple(round(row.nees, 1) for row in same if row.nees is not None)
        found.append(Mean(scheme, source, nees, round(float(np.mean(ate)), 3) if ate else None))
    return found


def read_table(file: Path = FILE) -> Table:
    """Reads what was measured."""
    entries = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return {m: [Mean(**{**row, "nees": tuple(row["nees"])}) for row in rows] for m, rows in entries.items()}


def write_table(table: Table, file: Path = FILE) -> None:
    """Writes one line for each row, in the order of the methods."""
    blocks = list[str]()
    for method in [m for m in names() if m in table]:
        lines = ",\n".join(f"    {json.dumps(asdict(row))}" for row in table[method])
        blocks.append(f"  {json.dumps(method)}: [\n{lines}\n  ]" if lines else f"  {json.dumps(method)}: []")
    file.write_text("{\n" + ",\n".join(blocks) + "\n}\n", encoding="utf-8")


def markdown(table: Table) -> str:
    """Returns the table of the page docs/evaluation/consistency.md, and the methods that state no covariance."""
    lines = ["| method | measured on | mean NEES | of each seed | |", "| --- | --- | --- | --- | --- |"]
    for method, row in ((m, row) for m in names() for row in table.get(m, [])):
        name = f"`{method}`" + (f", scheme {row.scheme}" if row.scheme else "")
        each = ", ".join(f"{n:.1f}" for n in row.nees)
        cause = "" if row.right else CAUSES.get((method, row.scheme or row.source), "")
        lines.append(f"| {name} | {row.source} | {row.mean:.1f} | {each} | {cause} |")
    silent = ", ".join(f"`{m}`" for m in names() if m in table and not table[m])
    return "\n".join(lines) + f"\n\nThese state no covariance: {silent}.\n"


if __name__ == "__main__":
    end_with_parent()
    cv2.setNumThreads(1)
    sys.stdout.write(json.dumps([asdict(row) for row in found_of(json.loads(sys.argv[1]))]) + "\n")
