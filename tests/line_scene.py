"""A rendered room with painted rectangles on its walls, along which a camera moves; all true poses are known."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from ispom.geometry import Array, Pose, so3_exp
from ispom.types import Camera, Frame, Image, Rig, Sequence, Trajectory

CAMERA = Camera(320, 240, 240.0, 240.0, 159.5, 119.5)
FINER = 3
"""Rendered pixels per pixel, along each side."""
PX_PER_M = 100
X, Y, Z = 1.8, 1.3, (1.6, 4.2)
"""Half width, half height, and the depths of the walls at the sides [m]."""


def _face(corner: tuple[float, float, float], along: Array, down: Array) -> tuple[Pose, tuple[float, float]]:
    """Returns world_from_face, z into the wall, and the size of a wall from its corner along its two sides [m]."""
    size = float(np.linalg.norm(along)), float(np.linalg.norm(down))
    x, y = along / size[0], down / size[1]
    return Pose(np.column_stack([x, y, np.cross(x, y)]), np.array(corner)), size


DEPTH = Z[1] - Z[0]
FACES = (
    _face((-X, -Y, Z[1]), np.array([2 * X, 0, 0]), np.array([0, 2 * Y, 0])),
    _face((-X, -Y, Z[0]), np.array([0, 0, DEPTH]), np.array([0, 2 * Y, 0])),
    _face((X, -Y, Z[1]), np.array([0, 0, -DEPTH]), np.array([0, 2 * Y, 0])),
    _face((-X, Y, Z[1]), np.array([2 * X, 0, 0]), np.array([0, 0, -DEPTH])),
    _face((-X, -Y, Z[0]), np.array([2 * X, 0, 0]), np.array([0, 0, DEPTH])),
)


def world_from_camera(i: float) -> Pose:
    """Sideways and ahead, with some turns."""
    t = i / 30
    place = np.array([-0.5 + 0.8 * t, 0.15 * np.sin(4 * t), 0.25 * t])
    return Pose(so3_exp(np.array([0.05 * np.sin(5 * t), 0.2 - 0.35 * t, 0.06 * np.sin(3 * t)])), place)


@cache
def painted(number: int) -> Image:
    """Returns the paint of a wall: rectangles along its sides on a blotchy ground."""
    rng = np.random.default_rng(number)
    width, height = (round(PX_PER_M * side) for side in FACES[number][1])
    ground = cv2.GaussianBlur(rng.normal(0, 60, (height, width)), (0, 0), 2.5)
    paint = np.asarray(90 + 12 * number + ground, float)
    for _ in range(16):
        x, y = rng.uniform(0, 0.85, 2) * (width, height)
        w, h = rng.uniform(30, 110, 2)
        paint[int(y) : int(y + h), int(x) : int(x + w)] += rng.choice([-55, 60, 80])
    return np.clip(paint, 0, 255).astype(np.uint8)


def rendered(pose: Pose, noise_seed: int | None = None) -> Image:
    """Returns the image (H, W) of the camera at world_from_camera."""
    size = (CAMERA.width * FINER, CAMERA.height * FINER)
    fine = np.zeros(size[::-1], np.uint8)
    to_fine = np.array([[FINER, 0, (FINER - 1) / 2], [0, FINER, (FINER - 1) / 2], [0, 0, 1.0]]) @ CAMERA.matrix
    to_face = np.array([[1 / PX_PER_M, 0, 0.5 / PX_PER_M], [0, 1 / PX_PER_M, 0.5 / PX_PER_M], [0, 0, 1.0]])
    for number, (world_from_face, _) in enumerate(FACES):
        face = pose.inverse() @ world_from_face
        homography = to_fine @ np.column_stack([face.rotation[:, :2], face.translation]) @ to_face
        paint = painted(number)
        ink = cv2.warpPerspective(paint, homography, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        mask = cv2.warpPerspective(np.full_like(paint, 255), homography, size, flags=cv2.INTER_NEAREST)
        fine = np.where(mask > 0, ink, fine).astype(np.uint8)
    image = cv2.resize(fine, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA).astype(float)
    if noise_seed is not None:
        image += np.random.default_rng(noise_seed).normal(0, 1.5, image.shape)
    return np.clip(image + 0.5, 0, 255).astype(np.uint8)


def line_sequence(frames: int = 24) -> Sequence:
    """Returns video at 30 Hz with its ground truth."""
    times_ns = 33_000_000 * np.arange(frames, dtype=np.int64)
    truth = Trajectory.of([(int(t), world_from_camera(i)) for i, t in enumerate(times_ns)])
    images = [rendered(world_from_camera(i), noise_seed=i) for i in range(frames)]
    return Sequence(
        "lines",
        Rig.single(CAMERA),
        times_ns,
        ("video",) * frames,
        lambda i: Frame.video(int(times_ns[i]), images[i]),
        truth,
    )
