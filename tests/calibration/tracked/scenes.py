"""Tracks of a moving camera whose lens is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ispom.calibration.tracked.tracks import Tracks
from ispom.geometry import Array, Pose
from ispom.types import Camera

LENS = Camera(752, 480, 430.0, 430.0, 380.0, 233.0, (-0.28, 0.07, 0.0, 0.0))
FAR = 12
"""Views in which a point is seen, at most."""


def wandering(t: float) -> Pose:
    """world_from_camera, t from 0 to 1: sideways, in and out, and turned about all axes."""
    turn = np.array([0.15 * np.sin(5 * t), 0.35 * np.sin(3 * t + 0.3), 0.1 * np.sin(7 * t)])
    return Pose.from_rotvec(turn, np.array([1.5 * t, 0.2 * np.sin(6 * t), 0.5 * np.sin(4 * t)]))


def straight(t: float) -> Pose:
    """Forward, without a turn."""
    return Pose(translation=np.array([0, 0, 3.0 * t]))


def over_floor(t: float) -> Pose:
    """Along, and swaying by two degrees: seen so, a floor hardly tells its relief from the camera's turns."""
    turn = 0.03 * np.array([np.sin(9 * t), np.sin(7 * t + 1), np.sin(5 * t)])
    return Pose.from_rotvec(turn, np.array([1.5 * t, 0.3 * np.sin(6 * t), 0.05 * np.sin(8 * t)]))


def turning(t: float) -> Pose:
    """On a tripod."""
    return Pose.from_rotvec(np.array([0.2 * np.sin(5 * t), 0.9 * t, 0.1 * np.sin(3 * t)]), np.zeros(3))


def tracks(
    seed: int,
    way: Callable[[float], Pose] = wandering,
    views: int = 14,
    points: int = 500,
    noise_px: float = 0.3,
    wrong: float = 0.0,
    zoom: float = 0.0,
    moving: float = 0.0,
    depths: tuple[float, float] = (3.0, 10.0),
) -> Tracks:
    """Of points in a box before the camera, from the one of `depths` to the other. A share of the places is `wrong`; a
    share of the points is on a thing that is `moving`. From the middle on the focal length is larger by the share
    `zoom`."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-5, 7, points), rng.uniform(-3, 3, points), rng.uniform(*depths, points)])
    first = rng.integers(-FAR // 2, views - 3, points)
    rows: list[tuple[int, int, Array]] = []
    for v in range(views):
        factor = 1 + zoom * (v >= views // 2)
        lens = replace(LENS, fx=factor * LENS.fx, fy=factor * LENS.fy)
        there = xyz + v / (views - 1) * np.array([1.5, 0.4, 0.0]) * (np.arange(points) < moving * points)[:, None]
        uv = lens.project(way(v / (views - 1)).inverse().apply(there))
        inside = ((uv > 5) & (uv < (LENS.width - 6, LENS.height - 6))).all(1)
        for m in np.flatnonzero(inside & (v >= first) & (v < first + FAR)).tolist():
            rows.append((m, v, uv[m] + rng.normal(0, noise_px, 2)))
    rows.sort(key=lambda row: row[:2])
    ids, counts = np.unique([row[0] for row in rows], return_counts=True)
    good = dict(zip(ids[counts >= 3].tolist(), range(len(ids)), strict=False))
    kept = [(good[m], v, uv) for m, v, uv in rows if m in good]
    uv = np.array([row[2] for row in kept])
    uv[rng.random(len(uv)) < wrong] += 20.0
    view, point = np.array([row[1] for row in kept]), np.array([row[0] for row in kept])
    return Tracks((LENS.width, LENS.height), 1.0, np.arange(views), view, point, uv)
