"""Frames between key frames (section 6.1): interpolated, then refined on the points that they see."""

from __future__ import annotations

import numpy as np

from ispom.estimators.paper.monocular.window import KeyFrameWindow
from ispom.solvers.localisation import refine_pose
from ispom.solvers.trajectory.interpolation import Interpolation, interpolate
from ispom.types import Trajectory


def fill_between(window: KeyFrameWindow, kind: Interpolation, threshold: float) -> KeyFrameWindow:
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
