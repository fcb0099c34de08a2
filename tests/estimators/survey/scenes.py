"""A textured plane in exact perspective: images and depths for known poses, without a renderer's own approximations."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.types import Camera, Image

CAMERA = Camera(320, 240, 250.0, 250.0, 159.5, 119.5)
NORMAL, DISTANCE = np.array([0.1, -0.2, 1.0]), 5.0
"""The plane: NORMAL . x = DISTANCE in the world."""


def texture(xy: Array) -> Array:
    """Returns grey levels (N,) at points (N, 2) of the plane: a sum of waves, smooth and without repetition."""
    rng = np.random.default_rng(5)
    waves, phases = rng.normal(0, 7.0, (24, 2)), rng.uniform(0, 2 * np.pi, 24)
    return 128 + 22 * np.sin(xy @ waves.T + phases).sum(axis=1) / np.sqrt(12)


def seen(world_from_camera: Pose, camera: Camera = CAMERA) -> tuple[Image, Array]:
    """Returns the image of the plane and the depth (H, W) of each pixel."""
    v, u = np.mgrid[: camera.height, : camera.width]
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
    in_world = rays @ world_from_camera.rotation.T
    depth = (DISTANCE - NORMAL @ world_from_camera.translation) / (in_world @ NORMAL)
    points = world_from_camera.translation + depth[:, None] * in_world
    grey = np.rint(np.clip(texture(points[:, :2]), 0, 255)).astype(np.uint8)
    return grey.reshape(camera.height, camera.width), depth.reshape(camera.height, camera.width)


def arc(k: int) -> Pose:
    """Returns world_from_camera of frame k: along an arc, with rotations."""
    turn = np.array([0.03 * np.sin(0.3 * k), -0.006 * k, 0.004 * k])
    return Pose.from_rotvec(turn, np.array([0.07 * k, 0.15 * np.sin(0.25 * k), 0.03 * k]))
