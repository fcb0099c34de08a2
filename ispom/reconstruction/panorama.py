"""A spherical panorama: images of known orientation joined in one equirectangular image.

Longitude goes to the right, latitude up, and the middle is where the z axis of the world points. Pixels near the middle
of an image count most, so that seams are soft and lie half-way between images (Szeliski, Image Alignment and Stitching,
2006, section 6.2). Parallax is ignored: a camera that translates gives double contours.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, rotation_angle_rad
from ispom.types import Camera, Image

WIDTH_PX = 2048
"""Of a full turn."""
SHARPNESS = 4
"""Power of the weight of a pixel: the larger, the narrower are seams."""
LEAST_WEIGHT = 1e-6
"""Of a covered pixel."""


def spaced(rotations: Array, angle_rad: float, most: int) -> NDArray[np.int64]:
    """Returns the indices of at most `most` of `rotations` (N, 3, 3), where each differs from those before it by
    `angle_rad` or more."""
    chosen = list[int]()
    for i, rotation in enumerate(rotations):
        if len(chosen) == most:
            break
        if not chosen or rotation_angle_rad(np.swapaxes(rotations[chosen], 1, 2) @ rotation).min() >= angle_rad:
            chosen.append(i)
    return np.array(chosen, np.int64)


def equirectangular(views: Iterable[tuple[Image, Array]], camera: Camera, width_px: int = WIDTH_PX) -> Image:
    """Returns RGB (H, W, 3) of images, grey or RGB, with their world_from_camera (3, 3); black where none sees.

    The result is cropped to what the images cover; that of no image is (0, 0, 3).
    """
    directions = _directions(width_px)
    height = len(directions)
    total, weights = np.zeros((height, width_px, 3), np.float32), np.zeros((height, width_px), np.float32)
    cosine, radial = _widest(camera), _weights(camera)
    for image, world_from_camera in views:
        rgb = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
        row, column = np.nonzero(directions @ world_from_camera[:, 2].astype(np.float32) >= cosine)
        uv = camera.project(directions[row, column].astype(float) @ world_from_camera)
        seen = np.isfinite(uv).all(axis=1) & (uv >= 0).all(axis=1)
        seen &= (uv <= (camera.width - 1, camera.height - 1)).all(axis=1)
        row, column, uv = row[seen], column[seen], uv[seen].astype(np.float32)
        if not len(uv):
            continue
        weight = _remapped(radial, uv)
        total[row, column] += weight[:, None] * _remapped(rgb, uv)
        weights[row, column] += weight
    covered = weights > LEAST_WEIGHT
    panorama = np.where(covered[..., None], total / np.maximum(weights, LEAST_WEIGHT)[..., None], 0)
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    if not len(rows):
        return np.zeros((0, 0, 3), np.uint8)
    cropped = panorama[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return np.rint(np.clip(cropped, 0, 255)).astype(np.uint8)


def _directions(width_px: int) -> NDArray[np.float32]:
    """Returns unit directions (H, W, 3) in the world (x right, y down, z ahead) of the pixels of the panorama."""
    longitude = (np.arange(width_px) + 0.5) / width_px * 2 * np.pi - np.pi
    latitude = (np.arange(width_px // 2) + 0.5) / (width_px // 2) * np.pi - np.pi / 2
    across, down = np.cos(latitude)[:, None], np.sin(latitude)[:, None]
    parts = np.broadcast_arrays(across * np.sin(longitude), down, across * np.cos(longitude))
    return np.stack(parts, axis=2).astype(np.float32)


def _widest(camera: Camera) -> float:
    """Returns the cosine of the largest angle between the optical axis and what the image shows."""
    right, below = camera.width - 1.0, camera.height - 1.0
    u, v = np.meshgrid(np.linspace(0, right, 9), np.linspace(0, below, 9))
    rays, valid = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    return float(rays[valid, 2].min()) - 0.01


def _weights(camera: Camera) -> NDArray[np.float32]:
    """Returns the weight (H, W) of each pixel: 1 in the middle, and next to nothing at the border."""
    across = 1 - np.abs(np.linspace(-1, 1, camera.width))
    down = 1 - np.abs(np.linspace(-1, 1, camera.height))
    return (np.maximum(np.minimum(across, down[:, None]), 0.02) ** SHARPNESS).astype(np.float32)


def _remapped(image: NDArray, uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns values (N,) or (N, 3) at uv (N, 2), bilinear."""
    # OpenCV takes maps of at most 32767 rows, so places are laid out in rows of 1024.
    count = len(uv)
    padded = np.zeros((-(-count // 1024) * 1024, 2), np.float32)
    padded[:count] = uv
    maps = padded.reshape(-1, 1024, 2)
    found = cv2.remap(image, maps, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[arg-type]
    return np.asarray(found, np.float32).reshape(len(padded), -1)[:count].squeeze(1 if image.ndim == 2 else ())
