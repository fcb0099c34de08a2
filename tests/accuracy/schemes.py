"""`python -m tests.accuracy schemes`: the covariances of `fused`, by scheme of Table 2, against simulated truth.

`python -m tests.accuracy.schemes '{"seed": N}'` prints what was found of one drive as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.estimators.survey.fused import FusedConfig
from ispom.evaluation.trajectory_error import error_against_truth
from ispom.geometry import Array, Pose, so3_exp
from ispom.methods import Config
from ispom.sensors.gnss import SimulatedGnss
from ispom.sequences import open_sequence
from ispom.types import Sequence, Step, Trajectory
from tests.nees import Errors

SOURCE = "sim:tiny?motion=drive&duration_s=12&sensor=imu&sensor=wheel&sensor=gnss&sensor=laser"
SCHEMES = "2345678"
"""1 is 2 with a better IMU, and 9 is `monocular`."""
START_M = 5.0
OPTICAL_FROM_LOCAL = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def schemes_of(seed: int) -> list[dict[str, Any]]:
    """Returns a row for each scheme: the mean NEES of its poses, and the error of its path [m]."""
    cv2.setNumThreads(1)
    sequence = open_sequence(f"{SOURCE}&seed={seed}")
    ensemble, rows = build(Config(), ("monocular",), sequence.rig), list[dict[str, Any]]()
    state, visual = ensemble.start(), dict[int, Step]()
    for i, kind in enumerate(sequence.kinds):
        if kind == "video":
            state, (visual[i],) = ensemble.step(state, sequence[i])
    final = ensemble.finish(state)["monocular"]
    for scheme in SCHEMES:
        steps, path = _played(scheme, sequence, visual, final)
        assert sequence.truth is not None
        error = error_against_truth(path, sequence.truth, sequence.rig, "se3")
        nees = _errors(scheme, steps, path, sequence.truth).nees()
        rows.append({"scheme": scheme, "seed": seed, "nees": float(nees.mean()), "ate_m": error and error.ate_m})
    return rows


def _played(
    scheme: Any, sequence: Sequence, visual: dict[int, Step], final: Trajectory
) -> tuple[list[Step], Trajectory]:
    """Returns the steps at images and the final path; `visual`: the steps of `monocular` by measurement."""
    estimator = FusedConfig(scheme=scheme, start_m=START_M).build(sequence.rig)
    state, steps = estimator.start(), list[Step]()
    for i, kind in enumerate(sequence.kinds):
        if kind == "stereo":
            continue
        state, step = estimator.step(state, sequence[i], {"visual": visual[i]} if i in visual else {})
        steps += [step] if i in visual else []
    return steps, estimator.finish(state, {"visual": final})


def _errors(scheme: str, steps: list[Step], path: Trajectory, truth: Trajectory) -> Errors:
    """Returns the errors in the gauge in which the scheme estimates: that of the fixes; else with the first pose as
    origin, and with an IMU with its heading, as up is measured."""
    at, first = next(iter(path.items()))
    true = truth.at(at)
    assert true is not None
    world_from_truth = first @ true.inverse()
    if scheme in "234":
        world_from_truth = Pose(OPTICAL_FROM_LOCAL @ SimulatedGnss().local_from_world)
    elif scheme in "56":
        world_from_truth = _level(world_from_truth.rotation, true.translation, first.translation)
    times, twists, covariances = [], [], []
    for step in steps:
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


def print_schemes(console: Console, rows: list[dict[str, Any]]) -> None:
    """Prints the mean over the drives, by scheme."""
    table = Table("scheme", "mean NEES (6 is right)", "of each drive", "mean ATE [m]", box=None, pad_edge=False)
    for scheme in SCHEMES:
        nees = [row["nees"] for row in rows if row["scheme"] == scheme]
        ate = [row["ate_m"] for row in rows if row["scheme"] == scheme]
        if nees:
            table.add_row(scheme, f"{np.mean(nees):.1f}", ", ".join(f"{n:.1f}" for n in nees), f"{np.mean(ate):.3f}")
    console.print(table)


if __name__ == "__main__":
    end_with_parent()
    sys.stdout.write(json.dumps(schemes_of(json.loads(sys.argv[1])["seed"])) + "\n")
