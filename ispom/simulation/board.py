"""A flat board as a camera sees it: lens distortion, blur, motion, noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.types import Camera, Image

SUBSAMPLES = 3
"""Rays per pixel in each direction."""
WALL = 96.0
"""Grey level of what is behind the board, on the average."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What is printed on the board."""

    grey: Image
    """(H, W)."""
    pixels_per_m: float
    margin_m: float
    """Pixel (j, i) is centred at ((j + 0.5) / pixels_per_m - margin_m, (i + 0.5) / pixels_per_m - margin_m)."""


@dataclass(frozen=True)
class Exposing:
    """What a real exposure adds."""

    blur_px: float = 0.6
    """Of the lens, standard deviation."""
    noise: float = 2.0
    """Grey levels, standard deviation."""
    contrast: float = 0.8
    """Of black and white, 1 for 0 and 255."""
    seed: int = 0


def board_image(
    picture: Picture, camera: Camera, camera_from_board: tuple[Pose, ...] | Pose, exposing: Exposing = Exposing()
) -> Image:
    """(H, W) grey. Several poses are those during one exposure (motion blur), each for the same time.

    The board lies in z = 0 of its frame; what is behind the camera is not seen.
    """
    poses = (camera_from_board,) if isinstance(camera_from_board, Pose) else camera_from_board
    light = np.asarray(sum(_seen(picture, camera, pose) for pose in poses), np.float32) / np.float32(len(poses))
    if exposing.blur_px > 0:
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), exposing.blur_px), np.float32)
    light = 127.5 + exposing.contrast * (light - 127.5)
    noise = np.random.default_rng(exposing.seed).standard_normal(light.shape, np.float32)
    return np.clip(light + exposing.noise * noise + 0.5, 0, 255).astype(np.uint8)


def _seen(picture: Picture, camera: Camera, camera_from_board: Pose) -> NDArray[np.float32]:
    """(H, W) without blur or noise."""
    rays = _rays(camera)
    rotation, translation = camera_from_board.rotation, camera_from_board.translation
    # Picture from board (x, y, 1), board from camera: one homography for all rays (x, y, 1).
    scale, shift = picture.pixels_per_m, picture.margin_m * picture.pixels_per_m - 0.5
    to_picture = np.array([[scale, 0, shift], [0, scale, shift], [0, 0, 1]])
    board_from_rays = np.linalg.inv(np.column_stack([rotation[:, :2], translation]))
    a, b, w = (cv2.transform(rays, row[None].astype(np.float32)) for row in to_picture @ board_from_rays)
    ahead = w > 0 if (np.linalg.inv(board_from_rays)[2, 2]) > 0 else w < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (np.where(ahead, side / w, -1e4).clip(-1e4, 1e5) for side in (a, b))
    wall = WALL + 20 * np.sin(9 * rays[..., 0] + 3) * np.sin(7 * rays[..., 1])
    seen = cv2.remap(picture.grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    height, width = picture.grey.shape
    on_board = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    fine = np.where(on_board, seen.astype(np.float32), wall)
    small = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> NDArray[np.float32]:
    """(s H, s W, 2) on the plane z = 1; between pixel centres by interpolation."""
    u, v = np.meshgrid(np.arange(-1.0, camera.width + 1), np.arange(-1.0, camera.height + 1))
    rays = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(*u.shape, 2)
    fine_u = (np.arange(SUBSAMPLES * camera.width) + 0.5) / SUBSAMPLES + 0.5
    fine_v = (np.arange(SUBSAMPLES * camera.height) + 0.5) / SUBSAMPLES + 0.5
    places = np.meshgrid(fine_u.astype(np.float32), fine_v.astype(np.float32))
    rays = rays.astype(np.float32)
    fine = [cv2.remap(rays[..., k], *places, cv2.INTER_LINEAR) for k in (0, 1)]
    return np.stack(fine, axis=-1).astype(np.float32)
