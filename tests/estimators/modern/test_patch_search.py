"""Points are found by the key frame's patches where the motion leads them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.pair import PairPoints, StereoImages
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.state import KeyFrame, ModernStereoState, StereoMap
from ispom.estimators.modern.stereo.track import Expected, search_patches
from ispom.geometry import Array, Pose
from ispom.types import Camera, Image, Rig, TrackStatus
from tests.estimators.modern.setups import setup_of
from tests.estimators.modern.waved_card import FX, SIZE, WALLS, drawn

CAMERA = Camera(SIZE[1], SIZE[0], FX, FX, SIZE[1] / 2, SIZE[0] / 2)
SETUP = setup_of(ModernStereoConfig().build(Rig.stereo(CAMERA, 0.3)))
WALL_M = 5.0
NOW = Pose.from_rotvec(np.array([0.0, 0.004, 0.01]), np.array([-0.03, 0.02, -0.9]))
"""left_from_world: it came nearer to the wall, which grows by a fifth."""


def image(left_from_world: Pose) -> Image:
    return drawn(left_from_world @ Pose(np.eye(3), np.array([0.0, 0.0, WALL_M])), WALLS[0], 0.01, None)


def seen_again(predicted: Pose, now: Image) -> tuple[Array, Array, NDArray[np.uint8]] | None:
    """Of points all over the first image: where they are, where they are found, and what became of them."""
    x, y = np.meshgrid(np.linspace(12, SIZE[1] - 13, 14), np.linspace(12, SIZE[0] - 13, 10))
    uv, ids = np.column_stack([x.ravel(), y.ravel()]).astype(np.float32), np.arange(140)
    points = PairPoints(ids, uv, np.full(140, FX * 0.3 / WALL_M, np.float32), np.zeros((140, 2)))
    seen = points.seen_by(CAMERA)
    xyz = np.column_stack([seen[:, :2], np.ones(140)]) * WALL_M
    world = StereoMap((KeyFrame(0, Pose(), ids, seen, np.zeros(12), points.slants),), ids, xyz)
    first, pair = StereoImages(0, image(Pose()), image(Pose())), StereoImages(100_000_000, now, now)
    last = LastPair(first.left, first.left, first.half, points)
    expected = Expected(predicted, predicted.apply(xyz))
    found = search_patches(SETUP, ModernStereoState(last, world), pair, expected)
    return None if found is None else (CAMERA.project(NOW.apply(xyz)), found.uv, found.status)


@pytest.mark.parametrize("off_px", [0.0, 1.0, 5.0])
def test_points_are_found_where_they_are(off_px: float) -> None:
    turned = Pose.from_rotvec(np.array([0.0, off_px / FX, 0.0]), np.zeros(3))
    again = seen_again(turned @ NOW, image(NOW))
    assert again is not None
    true, found, status = again
    alive = status == TrackStatus.ALIVE
    inside = ((true > 12) & (true < np.array(SIZE[::-1]) - 13)).all(axis=1)
    assert alive[inside].mean() > 0.97 and not alive[(true < 0).any(axis=1)].any()
    off = np.linalg.norm(found - true, axis=1)[alive]
    assert np.median(off) < 0.05 and np.percentile(off, 95) < 0.15
    assert (status[~alive & inside] == TrackStatus.LOST).all()
    assert (status[(true < -off_px).any(axis=1)] == TrackStatus.OUT_OF_IMAGE).all()


def test_where_the_motion_leads_elsewhere_nothing_is_said() -> None:
    turned = Pose.from_rotvec(np.array([0.0, 30 / FX, 0.0]), np.zeros(3))
    assert seen_again(turned @ NOW, image(NOW)) is None
    other = np.ascontiguousarray(image(NOW)[::-1])
    assert seen_again(NOW, other) is None
