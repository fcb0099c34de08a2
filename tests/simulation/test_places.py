"""The building and the moon: there is much to track, and the way is free."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from ispom.simulation.motions import motion_of
from ispom.simulation.rendering.scene import NOTHING
from ispom.simulation.source import Source

CLEAR_M = 0.45
"""The cameras reach 0.2 m to each side."""
WAYS = {"indoor": "walk", "moon": "flight"}


@cache
def source(place: str) -> Source:
    return Source(1, False, 0.5, place, WAYS[place])


@pytest.mark.parametrize("place", WAYS)
@pytest.mark.parametrize("at_s", [2, 28])
def test_there_is_much_to_track(place: str, at_s: int) -> None:
    image = source(place).render(at_s * 1_000_000_000, "video", 2)
    corners = cv2.goodFeaturesToTrack(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), 400, 0.005, 5)
    assert len(corners) > 150
    assert len(np.unique((corners.reshape(-1, 2) // (80, 80)).astype(int), axis=0)) > 6, "not in one place"


@pytest.mark.parametrize("place", WAYS)
def test_the_way_is_free(place: str) -> None:
    triangles, caster = source(place).scene.triangles.astype(float), source(place).scene.caster
    directions = np.random.default_rng(0).normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for t in range(0, 30, 2):
        at = motion_of(WAYS[place], 1).pose_at(t * 1_000_000_000).translation
        hits = caster.hits(at, directions.astype(np.float32))
        first, second, third = np.moveaxis(triangles[hits[hits != NOTHING]], 1, 0)
        normal = np.cross(second - first, third - first)
        ranges = ((first - at) * normal).sum(1) / (directions[hits != NOTHING] * normal).sum(1)
        assert ranges.min() > CLEAR_M, f"at {t} s"


def test_stairs_lead_up() -> None:
    walk = motion_of("walk", 1)
    assert walk.pose_at(0).translation[1] - walk.pose_at(29_000_000_000).translation[1] > 1.7


def test_the_moon_has_a_black_sky_and_grey_ground() -> None:
    image = source("moon").render(2_000_000_000, "video", 2).astype(int)
    assert image[:10].mean() < 12 and 40 < image[-40:].mean() < 200
    assert np.abs(image[-40:, :, 0] - image[-40:, :, 2]).mean() < 15
