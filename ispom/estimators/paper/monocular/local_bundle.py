"""Local bundle adjustment after each key frame (section 6.4, line D of Fig. 8)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.adjustment import optimised
from ispom.estimators.paper import checks
from ispom.estimators.paper.monocular.window import KeyFrameWindow
from ispom.estimators.tracked_frame import ScenePoints
from ispom.geometry import Pose
from ispom.solvers.bundle import adjust
from ispom.types import Decision

ITERATIONS = 10
"""Of each adjustment, at most."""
FIXED = 2
"""Key frames that hold the gauge and the unit."""
MIN_POINTS = 10
"""Fewer points leave the poses hardly better determined than before."""


def adjust_window(window: KeyFrameWindow, scale: float) -> tuple[KeyFrameWindow, tuple[Decision, ...]]:
    """Adjusts the window's key frames and points together; the first two key frames hold the gauge and the unit.

    Frames between older key frames move along with the key frame before them.
    """
    keys, fixed = window.keys, FIXED
    seen = [window.landmarks.places(k.ids) for k in keys]
    counts = np.bincount(np.concatenate([p[p >= 0] for p in seen]), minlength=len(window.landmarks.ids))
    chosen = np.flatnonzero(counts >= 2)
    slot = np.full(len(window.landmarks.ids) + 1, -1)
    slot[chosen] = np.arange(len(chosen))
    cameras, points, x = [], [], []
    for c, (key, place) in enumerate(zip(keys, seen, strict=True)):
        use = slot[place] >= 0
        cameras.append(np.full(use.sum(), c))
        points.append(slot[place[use]])
        x.append(key.x[use])
    poses = tuple(k.world_from_camera.inverse() for k in keys if k.world_from_camera is not None)
    if len(chosen) < MIN_POINTS or len(poses) <= fixed or len(poses) < len(keys):
        return window, ()
    bundle = adjust(
        poses,
        window.landmarks.xyz[chosen],
        np.concatenate(cameras),
        np.concatenate(points),
        np.concatenate(x),
        fixed,
        scale,
        ITERATIONS,
    )
    xyz = window.landmarks.xyz.copy()
    xyz[chosen] = bundle.xyz_in_world
    after = [p.inverse() for p in bundle.cameras_from_world]
    size = f"{len(keys)} key frames, {len(chosen)} points, {len(np.concatenate(points))} observations"
    decision = checks.BUNDLE_COST.of(bundle.cost_after / max(bundle.cost_before, 1e-12), 1.0, size)
    went = optimised(bundle.cost_before, bundle.cost_after, bundle.iterations, ITERATIONS)
    return _carried(window, after, ScenePoints(window.landmarks.ids, xyz)), (decision, *went)


def _carried(window: KeyFrameWindow, keys_after: list[Pose], landmarks: ScenePoints) -> KeyFrameWindow:
    """The window with moved key frames, every other frame moved as the key frame before it."""
    poses, correction, moved = {}, Pose(), {k.time_ns: p for k, p in zip(window.keys, keys_after, strict=True)}
    for frame in window.frames:
        if frame.world_from_camera is None:
            continue
        if frame.time_ns in moved:
            poses[frame.time_ns] = moved[frame.time_ns]
            correction = moved[frame.time_ns] @ frame.world_from_camera.inverse()
        else:
            poses[frame.time_ns] = correction @ frame.world_from_camera
    window = window.revised(poses)
    return replace(window, landmarks=landmarks)
