"""What an adjustment of the joint window tells: how well it went, and what is wrong with the calibration."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.solvers.continuous import Solution
from ispom.solvers.normal_equations import RIG
from ispom.types import Decision


def told(window: JointWindow, solution: Solution) -> tuple[Decision, ...]:
    """Of the window as adjusted."""
    problem = solution.problem
    ratio = solution.cost_after / max(solution.cost_before, 1e-12)
    size = f"{len(problem.times_s)} exposures, {len(problem.points)} points, {len(solution.errors)} observations"
    cost = Decision(
        "joint cost after / before",
        ratio,
        1.0,
        ratio <= 1,
        relation="<=",
        consequence=f"{size}, {len(problem.spline)} knots, {solution.iterations} iterations",
    )
    return (cost, *_told_rig(window))


def _told_rig(window: JointWindow) -> tuple[Decision, ...]:
    """What is found to be wrong with the calibration of the video camera, beside twice its standard deviation."""
    rig, change = window.rig, window.rig.minus(window.initial)
    spread = np.zeros((RIG, RIG))
    free = np.ix_(np.flatnonzero(rig.free), np.flatnonzero(rig.free))
    spread[free] = np.linalg.inv(window.beliefs[-1].information[free])
    found = []
    parts = (
        ("video camera turned", slice(0, 3), 180 / np.pi, "deg"),
        ("video camera shifted", slice(3, 6), 1e3, "mm"),
        ("clock offset of the video", slice(6, 7), 1e3, "ms"),
    )
    for name, part, unit, symbol in parts:
        if rig.free[part].all():
            value, sigma = unit * change[part], unit * np.sqrt(np.diag(spread)[part])
            size, limit = float(np.linalg.norm(value)), 2 * float(np.linalg.norm(sigma))
            each = ", ".join(f"{v:.3g} +- {s:.2g}" for v, s in zip(value, sigma, strict=True))
            found.append(
                Decision(name, float(value[0]) if len(value) == 1 else size, limit, size > limit, symbol, ">", each)
            )
    return tuple(found)
