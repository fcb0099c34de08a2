"""Made scenes: a camera or a pair that moves along a street of points, and sees them exactly."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose, so3_exp
from ispom.io.maps import SceneMap
from ispom.types import Camera, FrameName, Landmarks, Rig, Trajectory

LEFT = Camera(640, 480, 460.0, 460.0, 320.0, 240.0)
VIDEO = Camera(640, 480, 452.0, 455.0, 322.3, 237.1, (-0.22, 0.06, 0.0006, -0.0004))


def rig(camera: FrameName) -> Rig:
    return Rig.stereo(LEFT, 0.4) if camera == "left" else Rig.single(VIDEO)


def scene_map(camera: FrameName, count: int = 12, points: int = 300, seed: int = 0) -> SceneMap:
    """Of key frames 0.5 m apart on a bend, each with the points before it and within 25 m."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([rng.uniform(-9, 9, points), rng.uniform(-4, 3, points), rng.uniform(3, 25, points)])
    keys = []
    for k in range(count):
        turn = so3_exp(np.array([0.01 * np.sin(k), 0.03 * k, 0.01 * np.cos(k)]))
        keys.append((k * 300_000_000, Pose(turn, np.array([0.02 * k**1.5, 0.05 * np.sin(k), 0.5 * k]))))
    keys = Trajectory.of(keys, camera)
    lens, views, ids, uvs = rig(camera).camera(camera), [], [], []
    for k, (_, pose) in enumerate(keys.items()):
        near = pose.inverse().apply(xyz)
        uv = lens.project(near)
        seen = (near[:, 2] > 1) & (near[:, 2] < 25)
        seen &= (uv >= 0).all(1) & (uv <= (lens.width - 1, lens.height - 1)).all(1)
        # Those far beside the image come back into it by the lens polynomial.
        seen &= (np.abs(near[:, :2]) < near[:, 2:]).all(1)
        views += [k] * int(seen.sum())
        ids += np.flatnonzero(seen).tolist()
        uvs.append(uv[seen])
    landmarks = Landmarks(np.arange(points), xyz, np.zeros((points, 3), np.uint8))
    return SceneMap(landmarks, keys, np.array(views), np.array(ids), np.concatenate(uvs).astype(np.float32))
