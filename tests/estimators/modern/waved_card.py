"""Images of two textured walls, and of a card that hangs before them or is waved."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.geometry import Pose
from ispom.types import Image

FX, SIZE = 300.0, (240, 320)
"""Focal length [px], rows and columns."""


def texture(seed: int, size: tuple[int, int]) -> Image:
    noise = np.random.default_rng(seed).integers(0, 256, size, np.uint8)
    return np.asarray(cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 20, 235, cv2.NORM_MINMAX), np.uint8)  # type: ignore[call-overload]


def drawn(camera_from_plane: Pose, of: Image, scale: float, on: Image | None) -> Image:
    """A textured plane (its z = 0, `scale` metres a pixel of the texture, centred), over an image."""
    k = np.array([[FX, 0, SIZE[1] / 2], [0, FX, SIZE[0] / 2], [0, 0, 1]])
    plane = np.column_stack([camera_from_plane.rotation[:, :2], camera_from_plane.translation])
    size = np.array([of.shape[1], of.shape[0]])
    metres = np.array([[scale, 0, -scale * size[0] / 2], [0, scale, -scale * size[1] / 2], [0, 0, 1]])
    shape, way = (SIZE[1], SIZE[0]), k @ plane @ metres
    image = np.asarray(cv2.warpPerspective(of, way, shape, flags=cv2.INTER_LINEAR), np.uint8)
    if on is None:
        return image
    mask = cv2.warpPerspective(np.full_like(of, 255), way, shape, flags=cv2.INTER_NEAREST) > 0
    return np.where(mask, image, on).astype(np.uint8)


WALLS, CARD = [texture(i, (500, 700)) for i in (1, 2)], texture(3, (120, 120))


LARGE, LARGER = texture(4, (190, 230)), texture(5, (260, 310))


def seen(camera_from_world: Pose, number: int, waved: bool) -> Image:
    """The image of that number, from a pose."""
    image = drawn(camera_from_world @ Pose(np.eye(3), np.array([0.0, 0.0, 7.0])), WALLS[0], 0.02, None)
    slanted = Pose.from_rotvec(np.array([0.8, 0.0, 0.0]), np.array([0.0, 2.0, 4.5]))
    image = drawn(camera_from_world @ slanted, WALLS[1], 0.01, image)
    swung = np.array([0.05 * number - 1.0, -0.4 - 0.03 * np.sin(0.5 * number), 3.0])
    wave = Pose.from_rotvec(np.array([0.0, 0.0, 0.02 * number]), swung)
    hung = Pose(np.eye(3), np.array([0.0, -0.4, 3.0]))
    return drawn(camera_from_world @ (wave if waved else hung), CARD, 0.01, image)


def leaving(camera_from_world: Pose, moves: int, card: Image = LARGE) -> Image:
    """The walls behind a card that fills most of the image. It hung still until it began to move aside, `moves` moves
    ago."""
    image = drawn(camera_from_world @ Pose(np.eye(3), np.array([0.0, 0.0, 7.0])), WALLS[0], 0.02, None)
    slanted = Pose.from_rotvec(np.array([0.8, 0.0, 0.0]), np.array([0.0, 2.0, 4.5]))
    image = drawn(camera_from_world @ slanted, WALLS[1], 0.01, image)
    aside = Pose.from_rotvec(np.array([0.0, 0.0, 0.02 * moves]), np.array([0.0, -0.35 - 0.06 * moves, 3.0]))
    return drawn(camera_from_world @ aside, card, 0.01, image)
