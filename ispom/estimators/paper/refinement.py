"""Frames between key frames, and local bundle adjustment (section 6.1, steps 5 and 6; line D of Fig. 8)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.paper import checks
from ispom.estimators.paper.keyframes import Points, Window
from ispom.geometry import Pose
from ispom.solvers.bundle import adjust
from ispom.solvers.interpolation import Interpolation, interpolate
from ispom.solvers.resection import refine_pose
from ispom.types import Decision, Trajectory


def fill_between(window: Window, kind: Interpolation, threshold: float) -> Window:
    """Interpolates the frames between the last three key frames, then refines each on the points it sees.

    The refinement is motion-only: it keeps the shake that an interpolation cannot know.
    """
    keys = Trajectory.of([(k.time_ns, k.world_from_camera) for k in window.keys if k.world_from_camera is not None])
    start, key_times = window.keys[-3].time_ns, {k.time_ns for k in window.keys}
    between = [f for f in window.frames if f.time_ns > start and f.time_ns not in key_times]
    if not between:
        return window
    guesses = interpolate(keys, np.array([f.time_ns for f in between], np.int64), kind)
    poses = {}
    for i, frame in enumerate(between):
        place = window.landmarks.places(frame.ids)
        known = place >= 0
        refined = refine_pose(window.landmarks.xyz[place[known]], frame.x[known], guesses.pose(i).inverse(), threshold)
        poses[frame.time_ns] = guesses.pose(i) if refined is None else refined.camera_from_world.inverse()
    return window.revised(poses)


def adjust_window(window: Window, scale: float) -> tuple[Window, tuple[Decision, ...]]:
    """Adjusts the window's key frames and points together; the first two key frames hold the gauge and the unit.

    Frames between older key frames move along with the key frame before them.
    """
    keys, fixed = window.keys, 2
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
    if len(chosen) < 10 or len(poses) <= fixed or len(poses) < len(keys):
        return window, ()
    bundle = adjust(
        poses,
        window.landmarks.xyz[chosen],
        np.concatenate(cameras),
        np.concatenate(points),
        np.concatenate(x),
        fixed,
        scale,
    )
    xyz = window.landmarks.xyz.copy()
    xyz[chosen] = bundle.xyz_in_world
    after = [p.inverse() for p in bundle.cameras_from_world]
    size = f"{len(keys)} key frames, {len(chosen)} points, {len(np.concatenate(points))} observations"
    decision = checks.BUNDLE_COST.of(bundle.cost_after / max(bundle.cost_before, 1e-12), 1.0, size)
    return _carried(window, after, Points(window.landmarks.ids, xyz)), (decision,)


def _carried(window: Window, keys_after: list[Pose], landmarks: Points) -> Window:
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
