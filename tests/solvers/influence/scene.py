"""A pair that flies past exact points, some of which move by themselves as one thing."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose, so3_exp
from ispom.solvers.influence.window import WindowProblem
from ispom.solvers.right_camera import COLUMNS, PAIR
from ispom.solvers.window.adjustment import Window, adjust
from ispom.solvers.window.prior import Prior, anchored

POSES, POINTS, BASELINE, SCALE = 5, 80, 0.5, 0.7e-3
BUS = tuple(range(40, 47))
"""Ids of the points that move, close together in the image."""


def poses() -> tuple[Array, Array]:
    """True camera_from_world (C, 3, 3) and (C, 3): ahead, turning slowly."""
    k = np.arange(float(POSES))[:, None]
    return so3_exp(k * np.array([0.002, 0.01, 0.0])), k * np.array([0.02, 0.0, -0.4])


def points() -> Array:
    """(M, 3) at the first pose."""
    rng = np.random.default_rng(3)
    xyz = np.column_stack([rng.uniform(-0.5, 0.5, POINTS), rng.uniform(-0.3, 0.3, POINTS), np.ones(POINTS)])
    xyz[list(BUS), :2] = rng.uniform([0.27, -0.13], [0.33, -0.07], (len(BUS), 2))
    depth = rng.uniform(5, 20, (POINTS, 1))
    depth[list(BUS)] = rng.uniform(10, 11, (len(BUS), 1))
    return xyz * depth


def window(bus_m: float, prior: Prior | None = None) -> Window:
    """The bus moves by so much from pose to pose; the start is a little wrong everywhere."""
    rng, (rotations, translations), xyz = np.random.default_rng(1), poses(), points()
    owner, camera = np.repeat(np.arange(POINTS), POSES), np.tile(np.arange(POSES), POINTS)
    moving = np.isin(owner, BUS)[:, None] * camera[:, None] * np.array([bus_m, 0.0, 0.0])
    q = np.einsum("kij,kj->ki", rotations[camera], xyz[owner] + moving) + translations[camera]
    seen = np.column_stack([q[:, 0], q[:, 1], q[:, 0] - BASELINE]) / q[:, 2:]
    off = np.vstack([np.zeros(3), rng.normal(0, 1e-3, (POSES - 1, 3))])
    no_extra = np.zeros(PAIR)
    return Window(
        so3_exp(off) @ rotations, translations + off, xyz * rng.normal(1, 1e-3, (POINTS, 1)), camera, owner, seen,
        BASELINE, no_extra, no_extra, np.zeros((len(owner), COLUMNS)),
        prior or anchored(rotations[0], translations[0], no_extra),
    )  # fmt: skip


def solved(start: Window) -> WindowProblem:
    found = adjust(start, SCALE, 100, 1e-14).window
    return WindowProblem(start, found, SCALE, np.arange(POINTS), tuple(range(0, 100 * POSES, 100)), "left")


def truth() -> Pose:
    """world_from_camera of the newest pose."""
    rotations, translations = poses()
    return Pose(rotations[-1], translations[-1]).inverse()
