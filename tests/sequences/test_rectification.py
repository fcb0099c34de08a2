"""Rectified images are what a camera without distortion would have seen."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Array
from ispom.sequences.rectification import remapped, undistortion
from ispom.types import Camera

SIZE = 320, 240


def scene(uv: Array, finest: float = 0.4) -> Array:
    """Grey values (...) of a texture at (..., 2) [px], of waves of up to `finest` [rad/px]."""
    rng = np.random.default_rng(0)
    waves, phases, heights = rng.uniform(-finest, finest, (40, 2)), rng.uniform(0, 7, 40), rng.uniform(2, 8, 40)
    return 128 + np.sin(uv @ waves.T + phases) @ heights


@pytest.mark.parametrize("lens", ["opencv", "fisheye"])
def test_what_is_seen_is_where_it_would_be_without_distortion(lens: str) -> None:
    distortion = (-0.1, 0.01, 0.001, -0.001) if lens == "opencv" else (-0.013, 0.004, -0.002, 0.0005)
    raw = Camera(*SIZE, 200.0, 202.0, 161.3, 118.8, distortion, "fisheye" if lens == "fisheye" else "opencv")
    straight = Camera(*SIZE, 231.0, 231.0, 159.5, 119.5)
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(float)
    maps = undistortion(raw, np.eye(3), straight.matrix, SIZE)
    ray = np.concatenate([straight.normalise(grid.reshape(-1, 2)), np.ones((SIZE[0] * SIZE[1], 1))], axis=1)
    at = raw.project(ray).reshape(*grid.shape)
    # Rounded to 1/32 px, as OpenCV's faster maps are, neighbours would be off together, and tracks with them.
    np.testing.assert_allclose(np.stack(maps, axis=-1), at, atol=1e-3)
    found = remapped(np.rint(scene(grid)).astype(np.uint8), maps)
    true = scene(at)
    inside = ((at > 4) & (at < np.array(SIZE) - 5)).all(axis=-1) & (np.abs(true - 128) < 120)
    off = (found - true)[inside]
    assert inside.sum() > 30_000 and not found.flags.writeable
    assert abs(off.mean()) < 0.05 and off.std() < 0.7


@pytest.mark.parametrize("shift", [0.1, 0.25, 0.4])
def test_fine_texture_between_pixels_is_where_it_is(shift: float) -> None:
    """By lines between pixels it is up to a tenth nearer to the next pixel, by OpenCV's cubics as much farther."""
    raw = Camera(*SIZE, 200.0, 200.0, 159.5, 119.5)
    straight = Camera(*SIZE, 200.0, 200.0, 159.5 - shift, 119.5)
    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).astype(float)
    maps = undistortion(raw, np.eye(3), straight.matrix, SIZE)
    found = remapped(np.rint(np.clip(scene(grid, 1.2), 0, 255)).astype(np.uint8), maps).astype(float)

    def at(place: float) -> Array:
        return np.clip(scene(grid + np.array([place, 0.0]), 1.2), 0, 255)[8:-8, 8:-8]

    slope = (at(shift + 0.01) - at(shift - 0.01)) / 0.02
    off = float(((found[8:-8, 8:-8] - at(shift)) * slope).sum() / (slope**2).sum())
    assert abs(off) < 0.01 * shift
