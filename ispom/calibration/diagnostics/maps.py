"""Over the image: how uncertain projections are, and how much two calibrations differ.

A small turn of the camera changes no picture's geometry, and calibrations differ by one without meaning it: it is taken
out as far as it explains the difference (as mrcal does; Kogan, mrcal documentation, "Projection uncertainty").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.calibration.adjust.lens import projected
from ispom.geometry import Array, skew
from ispom.types import Camera

COLUMNS, ROWS = 24, 16


@dataclass(frozen=True, eq=False)
class ImageMap:
    """Vectors or sizes on a grid over the image."""

    uv: Array
    """(R, C, 2) [px] where."""
    px: Array
    """(R, C) how much."""
    vectors: Array | None = None
    """(R, C, 2) [px] in which direction, where that is known."""


def grid_over(camera: Camera) -> Array:
    """(R C, 2) pixels, the image's corners included."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, COLUMNS), np.linspace(0, camera.height - 1, ROWS))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def uncertainty_map(camera: Camera, covariance: Array) -> ImageMap:
    """Standard deviation of the projection of far points, of the camera's covariance (P, P); the larger axis.

    Infinite where a parameter's variance is.
    """
    uv, rays = _seen_rays(camera)
    by_camera, by_turn = _jacobians(camera, rays)
    if not np.isfinite(np.diag(covariance)).all():
        return _shaped(uv, np.full(len(uv), np.inf))
    flat = by_camera.reshape(-1, by_camera.shape[2])
    rotation = by_turn.reshape(-1, 3)
    turned = flat - rotation @ np.linalg.lstsq(rotation, flat, rcond=None)[0]
    blocks = turned.reshape(by_camera.shape)
    variances = np.einsum("nip,pq,njq->nij", blocks, covariance, blocks)
    return _shaped(uv, np.sqrt(np.linalg.eigvalsh(variances)[:, -1].clip(0)))


def difference_map(one: Camera, other: Camera) -> ImageMap:
    """Where the other camera sees what the one sees on the grid: with the turn that brings them nearest."""
    uv, rays = _seen_rays(one)
    turned = rays
    for _ in range(3):
        seen, by_point, _ = projected(other, turned)
        by_turn = -by_point @ skew(turned)
        step = np.linalg.lstsq(by_turn.reshape(-1, 3), (uv - seen).ravel(), rcond=None)[0]
        turned = turned + np.cross(step, turned)
    vectors = projected(other, turned)[0] - uv
    return ImageMap(
        uv.reshape(ROWS, COLUMNS, 2), np.linalg.norm(vectors, axis=1).reshape(ROWS, COLUMNS),
        vectors.reshape(ROWS, COLUMNS, 2),
    )  # fmt: skip


def _seen_rays(camera: Camera) -> tuple[Array, Array]:
    uv = grid_over(camera)
    xy = np.nan_to_num(camera.normalise(uv)).clip(-50, 50)
    rays = np.column_stack([xy, np.ones(len(xy))])
    return uv, rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _jacobians(camera: Camera, rays: Array) -> tuple[Array, Array]:
    """Of pixels by the camera's vector (N, 2, P), and by a turn of the rays (N, 2, 3)."""
    _, by_point, by_camera = projected(camera, rays)
    return by_camera, -by_point @ skew(rays)


def _shaped(uv: Array, px: Array) -> ImageMap:
    return ImageMap(uv.reshape(ROWS, COLUMNS, 2), px.reshape(ROWS, COLUMNS))
