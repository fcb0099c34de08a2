"""Corners are spread over the image: no part of it has more than its share, or a multiple of that."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.features.shi_tomasi import detect_spread
from ispom.types import Image

COUNT, SIDE = 80, 60
NONE = np.zeros((0, 2), np.float32)


def blocks(contrast: NDArray[np.float64]) -> Image:
    """Random squares of 6 pixels; `contrast` (rows, columns) in parts of SIDE pixels."""
    height, width = SIDE * np.array(contrast.shape)
    squares = np.random.default_rng(3).uniform(-1, 1, (height // 6, width // 6))
    wide = np.kron(contrast, np.ones((SIDE, SIDE)))
    return np.clip(128 + wide * np.kron(squares, np.ones((6, 6))), 0, 255).astype(np.uint8)


def counts(uv: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Corners in each part of SIDE pixels."""
    rows, columns = (uv[:, ::-1] // SIDE).astype(int).T
    return np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1]).reshape(shape)


CORNER = np.full((4, 4), 20.0)
CORNER[:2, :2] = 120.0
"""A quarter of the image has six times the contrast of the rest."""


@pytest.mark.parametrize("crowd", [1.0, 2.0])
def test_the_strongest_are_no_more_than_their_multiple(crowd: float) -> None:
    found = counts(detect_spread(blocks(CORNER), COUNT, NONE, 6.0, crowd=crowd), CORNER.shape)
    assert found.sum() == COUNT
    assert found.max() <= crowd * COUNT / CORNER.size + 1e-9
    assert found[:2, :2].sum() == crowd * COUNT / 4


def test_without_a_bound_all_are_where_texture_is_strongest() -> None:
    found = counts(detect_spread(blocks(CORNER), COUNT, NONE, 6.0, crowd=100.0), CORNER.shape)
    assert found[:2, :2].sum() == COUNT


def test_those_taken_count() -> None:
    image = blocks(CORNER)
    first = detect_spread(image, COUNT, NONE, 6.0, crowd=2.0)[::2]
    more = detect_spread(image, COUNT, first, 6.0, crowd=2.0)
    both = np.concatenate([first, more])
    assert len(both) == COUNT and counts(both, CORNER.shape).max() <= 2 * COUNT / CORNER.size
    apart = np.linalg.norm(both[:, None] - both[None], axis=2) + 1e9 * np.eye(len(both))
    assert apart.min() >= 6.0


@pytest.mark.parametrize("times", [1, 2])
def test_an_image_that_stands_has_the_corners_of_one_that_lies(times: int) -> None:
    lying = blocks(np.tile(np.hstack([CORNER, 60 + 0 * CORNER]), (times, times)))
    found = detect_spread(lying, COUNT, NONE, 6.0, crowd=2.0)
    upright = detect_spread(np.ascontiguousarray(lying.T), COUNT, NONE, 6.0, crowd=2.0)
    assert {(u, v) for u, v in found.tolist()} == {(u, v) for v, u in upright.tolist()}
