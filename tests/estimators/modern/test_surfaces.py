"""Slopes of surfaces by the points around: of one plane, of two, and where nothing is known; patches follow them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.estimators.modern.monocular.align import REACH, slopes
from ispom.features.patches import warps_of
from ispom.geometry import Array, Pose
from ispom.types import Camera


def spread(count: int, seed: int = 0) -> Array:
    """(N, 2) normalised places."""
    return np.random.default_rng(seed).uniform(-0.4, 0.4, (count, 2))


def points(xy: Array, inverse: Array) -> Array:
    """(N, 3) at normalised places and inverse depths."""
    return np.column_stack([xy, np.ones(len(xy))]) / inverse[:, None]


@given(st.tuples(*[st.floats(-0.5, 0.5)] * 2), st.floats(0.01, 10.0))
def test_of_one_plane_the_slope_is_its_own(slope: tuple[float, float], nearness: float) -> None:
    xy = spread(300)
    found = slopes(points(xy, nearness * (1 + xy @ slope)))
    inner = np.abs(xy).max(axis=1) < 0.4 - REACH / 2
    off = np.abs(found[inner] - nearness * np.array(slope)) / nearness
    assert np.percentile(off, 90) <= 0.4 * np.abs(slope).max() + 1e-12, "but for a few with hardly any neighbours"
    assert np.median(off) <= 0.2 * np.abs(slope).max() + 1e-12


def test_another_surface_beside_it_is_left_out() -> None:
    xy = spread(500, 1)
    left = xy[:, 0] < 0
    inverse = np.where(left, 0.5 + 0.3 * xy[:, 1], 0.2 - 0.1 * xy[:, 0])
    found, at_edge = slopes(points(xy, inverse)), np.abs(xy[:, 0]) < REACH / 2
    assert np.median(np.abs(found[left & at_edge] - (0.0, 0.3)).max(axis=1)) < 0.05
    assert np.median(np.abs(found[~left & at_edge] - (-0.1, 0.0)).max(axis=1)) < 0.03


def test_what_is_not_in_front_says_nothing() -> None:
    front = points(spread(300), 0.5 + 0.2 * spread(300)[:, 0])
    for behind in (-front, np.zeros((300, 3)), np.full((300, 3), np.nan)):
        found = slopes(np.vstack([front, behind]))
        np.testing.assert_array_equal(found[:300], slopes(front))
        assert not found[300:].any()


def test_alone_or_along_a_line_nothing_is_made_up() -> None:
    assert not slopes(np.array([[0.2, 0.4, 2.0]])).any()
    assert slopes(np.zeros((0, 3))).shape == (0, 2)
    line = np.column_stack([np.linspace(-0.05, 0.05, 9), np.zeros(9)])
    found = slopes(points(line, 0.5 + 0.4 * line[:, 0]))
    assert found[4, 0] == pytest.approx(0.4, abs=0.08) and not found[:, 1].any()


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.1, 0.55)])
def test_warps_are_those_of_the_surface_in_perspective(slope: tuple[float, float]) -> None:
    camera = Camera(640, 480, 450.0, 455.0, 320.0, 240.0)
    reference_from_camera = Pose.from_rotvec(np.array([0.02, -0.05, 0.1]), np.array([0.2, -0.1, 0.6]))
    uv, inverse = np.array([[350.0, 330.0]]), 0.4
    middle = camera.normalise(uv)

    def seen(uv: Array) -> Array:
        xy = camera.normalise(uv)
        depth = 1 / (inverse + (xy - middle) @ slope)
        return camera.project(reference_from_camera.apply(np.column_stack([xy, np.ones(len(xy))]) * depth[:, None]))

    xyz = np.column_stack([middle, np.ones(1)]) / inverse
    turn, way = reference_from_camera.rotation[None], reference_from_camera.translation[None]
    warps, bends = warps_of(camera, turn, way, xyz, np.array([slope]))
    beside = np.array([[12.0, 0.0], [-9.0, 7.0], [0.0, -12.0]])
    there = beside @ warps[0].T / (1 + beside @ bends[0])[:, None]
    np.testing.assert_allclose(there, seen(uv + beside) - seen(uv), atol=1e-6)
    if not any(slope):
        np.testing.assert_array_equal(warps, warps_of(camera, turn, way, xyz)[0])
