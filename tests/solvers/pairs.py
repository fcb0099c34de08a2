"""A pair that is wrong, by the camera model itself: what it sees."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import TERMS
from ispom.types import Camera

F, BASELINE = 700.0, 0.5
RATE = np.array([0.5, 0.1, -24.0, 0.02, -0.2, 0.01])
"""Ahead at 24 m/s in a bend: what is seen comes nearer."""
SIGMA = np.array([*[0.01] * 2, 0.5 / F, *[0.01] * 3, 0.003, *[0.01] * 2, *[0.005] * 4, 0.01, 0.005, 0.5 / F, 0.01])
"""Of right_camera.TERMS."""


def points(count: int = 300) -> Array:
    """(N, 3) of the left camera, 8 to 200 m away."""
    rng = np.random.default_rng(2)
    depth = 1 / rng.uniform(1 / 200, 1 / 8, count)
    xyz = np.column_stack([rng.uniform(-0.7, 0.7, count), rng.uniform(-0.25, 0.2, count), np.ones(count)])
    return xyz * depth[:, None]


def seen(xyz: Array, extra: Array, rate: Array = RATE) -> Array:
    """(N, 2) normalised, where a right camera that is wrong by `extra` sees the points, by the camera model itself."""
    value = dict(zip(TERMS, extra, strict=True))
    turned = Pose.from_rotvec(np.array([value[t] for t in ("pitch", "yaw", "roll")]), np.zeros(3)).inverse()
    place = BASELINE * np.array([1.0, value["down"], value["ahead"]])
    in_right = turned.apply(Pose.exp(rate * value["lag"]).apply(xyz) - place)
    radial = (float(value[k] + value[f"both_{k}"]) for k in ("k1", "k2"))
    focal, lens = 1 + value["focal"], (*radial, float(value["p1"]), float(value["p2"]))
    centre = value["offset_x"] + value["yaw"], value["offset_y"] - value["pitch"]
    x = Camera(1, 1, focal, focal, *centre, lens).project(in_right)
    square, growth = (x**2).sum(1), np.zeros((len(x), 2))
    growth[:, 0] = 2 * value["q1"] * x[:, 0] * x[:, 1] + value["q2"] * (square + 2 * x[:, 0] ** 2)
    growth[:, 1] = 2 * value["q2"] * x[:, 0] * x[:, 1] + value["q1"] * (square + 2 * x[:, 1] ** 2)
    return x + growth * square[:, None]


def seen_left(xyz: Array, extra: Array) -> Array:
    """(N, 2) normalised, where its left camera sees them."""
    value = dict(zip(TERMS, extra, strict=True))
    return Camera(1, 1, 1.0, 1.0, 0.0, 0.0, (float(value["both_k1"]), float(value["both_k2"]), 0.0, 0.0)).project(xyz)
