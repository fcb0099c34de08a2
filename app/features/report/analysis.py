"""What a report computes from a run: errors and scale over time, and its counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ispom.evaluation.trajectory_error import (
    MIN_POSES,
    TrajectoryError,
    alignment_of,
    associate,
    placed,
    trajectory_error,
)
from ispom.geometry import rotation_angle_rad
from ispom.methods import method as registered
from ispom.types import Trajectory

from ...presentation.texts import ALIGNED
from .folder import Run
from .steps import DecisionRow, Steps

WINDOW_NS = 1_000_000_000
"""Time over which lengths are compared; for a run shorter than five of these, a fifth of the run."""
MIN_MOTION_M = 0.05
"""A true motion shorter than this says nothing about scale."""
ROUTINE = 0.8
"""A test that passes more rarely than this asks a question; its failure is no trouble."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Of the poses that have a true partner (N): positions after alignment, orientations after the mean turn."""

    times_ns: np.ndarray
    position_m: np.ndarray
    rotation_deg: np.ndarray


def plotted(run: Run, method: str) -> tuple[Trajectory, str]:
    """The trajectory in the truth's world, and how it was brought there: as in metrics.json, so that the numbers agree.

    Without truth the monocular one is brought to the best metric one, whose unit it lacks.
    """
    estimate = run.trajectories[method]
    reference = run.truth if run.truth is not None else _metric(run, method)
    if reference is None:
        return estimate, "its own world" + (" and unit" if registered(method).unit == "own" else "")
    error = _error(estimate, reference, method)
    if error is None:
        return estimate, "not aligned: too few poses in common"
    of = "truth" if run.truth is not None else "the metric trajectory"
    how = f"{ALIGNED[error.alignment]} to {of}, {len(error.estimate)} poses"
    return placed(estimate, error.reference_from_estimate), how


def _error(estimate: Trajectory, reference: Trajectory, method: str) -> TrajectoryError | None:
    return trajectory_error(estimate, reference, alignment_of(registered(method).unit == "metric"))


def _metric(run: Run, method: str) -> Trajectory | None:
    if registered(method).unit == "metric":
        return None
    metric = [t for m, t in run.trajectories.items() if registered(m).unit == "metric"]
    return max(metric, key=len, default=None)


def errors(run: Run, method: str) -> Errors | None:
    """None without truth, or with too few poses."""
    if run.truth is None:
        return None
    error = _error(run.trajectories[method], run.truth, method)
    if error is None:
        return None
    own, true = error.aligned, error.reference
    # Positions leave the turn about a straight path open: orientations are aligned by themselves.
    differences = true.rotations @ np.swapaxes(own.rotations, 1, 2)
    turned = rotation_angle_rad(_mean_rotation(differences).T @ differences)
    return Errors(own.times_ns, error.position_errors_m, np.rad2deg(turned))


def _mean_rotation(rotations: np.ndarray) -> np.ndarray:
    """(3, 3) nearest to all (N, 3, 3), by the chordal distance (Hartley et al. 2013, section 5.3)."""
    return Rotation.from_matrix(rotations).mean().as_matrix()


def step_scale(run: Run, method: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Times (N,) [ns] and (N,) the length moved in the window before over the true one.

    Of metric methods the plain ratio; of the monocular one relative to its first ten. None without truth or motion.
    """
    if run.truth is None:
        return None
    own, true = associate(run.trajectories[method], run.truth)
    if len(own) < MIN_POSES:
        return None
    since_ns = own.times_ns - own.times_ns[0]
    window_ns = min(WINDOW_NS, int(since_ns[-1]) // 5)
    after = np.flatnonzero(since_ns >= window_ns)
    before = np.searchsorted(since_ns, since_ns[after] - window_ns, side="right") - 1
    moved, really = (np.linalg.norm(t.translations[after] - t.translations[before], axis=1) for t in (own, true))
    moving = really > MIN_MOTION_M
    if not moving.any():
        return None
    ratio = moved[moving] / really[moving]
    if registered(method).unit == "own":
        first = float(np.median(ratio[:10]))
        if first <= 0:
            return None
        ratio = ratio / first
    return own.times_ns[after[moving]], ratio


def notable(run: Run) -> list[DecisionRow]:
    """Failed requirements that state a consequence, or that nearly always pass."""
    outcomes: dict[tuple[str, str], list[bool]] = {}
    for row in run.decisions:
        outcomes.setdefault((row.method, row.decision.name), []).append(row.decision.passed)
    routine = {key for key, passed in outcomes.items() if np.mean(passed) < ROUTINE}
    return [
        row
        for row in run.decisions
        if row.decision.failed and (row.decision.consequence or (row.method, row.decision.name) not in routine)
    ]


def changes(steps: Steps) -> list[tuple[int, str, str]]:
    """(row, status before, status after) wherever the status changed; before the first it is empty."""
    before = ("", *steps.status[:-1])
    return [(i, a, b) for i, (a, b) in enumerate(zip(before, steps.status, strict=True)) if a != b]
