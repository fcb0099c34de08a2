"""What key frames with a rolling shutter show to loops and to lost cameras: where the middle row would have seen it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.estimators.modern.keyframe_database import Keyframe
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular import conclude as of_camera
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.match_keyframes import _triangulate, at_middle_row_of
from ispom.estimators.modern.monocular.tracks import TrackingResult
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.loop import described_points
from ispom.estimators.modern.stereo.pair import StereoImages
from ispom.estimators.modern.stereo.state import StereoMap
from ispom.features.sift import SIFT
from ispom.geometry import Pose
from ispom.types import Camera, Image, Rig, TrackStatus
from tests.estimators.modern.setups import setup_of

FX, ROWS_PX, READOUT_S, DISPARITY_PX = 300.0, 240, 0.03, 8


def camera(readout_s: float) -> Camera:
    return Camera(320, ROWS_PX, FX, FX, 159.5, 119.5, line_delay_s=readout_s / (ROWS_PX - 1))


def texture(width: int) -> Image:
    noise = np.random.default_rng(0).uniform(0, 255, (ROWS_PX, width))
    return np.clip(4 * (cv2.GaussianBlur(noise, (0, 0), 2.0) - 127) + 127, 0, 255).astype(np.uint8)


def late_s(uv: np.ndarray, readout_s: float) -> np.ndarray:
    return readout_s * (uv[:, 1:] - (ROWS_PX - 1) / 2) / (ROWS_PX - 1)


@pytest.mark.parametrize("readout_s", [0.0, READOUT_S])
def test_features_of_a_camera_move_as_the_tracks_beside_them(readout_s: float) -> None:
    """On the left and on the right half of the image at different speeds; a track that ended says nothing."""
    uv = np.array([[60, 120], [260, 120], [160, 120]], np.float32)
    status = np.array([TrackStatus.ALIVE, TrackStatus.ALIVE, TrackStatus.LOST], np.uint8)
    speeds = np.array([[100, -50], [200, 30], [9000, 9000]], np.float32)
    followed = TrackingResult(uv, status, speeds * (readout_s > 0))
    grey, view = texture(320), camera(readout_s)
    sight = of_camera._describe(
        setup_of(ModernMonocularConfig().build(Rig.single(view))), Lens(view, np.zeros(2)), followed, grey, 5.0
    )
    found = SIFT.detect_and_describe(grey, 800).uv
    speed = np.where(found[:, :1] < 160, speeds[0], speeds[1])
    np.testing.assert_allclose(sight.x, view.normalise(found - late_s(found, readout_s) * speed), atol=1e-5)


@pytest.mark.parametrize("readout_s", [0.0, READOUT_S])
def test_features_and_points_of_a_pair_are_those_of_one_time(readout_s: float) -> None:
    view, wide = camera(readout_s), texture(320 + DISPARITY_PX)
    setup = setup_of(ModernStereoConfig().build(Rig.stereo(view, 0.5)))
    new = StereoImages(0, np.ascontiguousarray(wide[:, :320]), np.ascontiguousarray(wide[:, DISPARITY_PX:]))
    sight = described_points(setup, StereoMap(), new, steady(np.array([0.5, 0.3, 1.0, 0.2, -0.3, 0.4])))
    points, known = sight.xyz, np.isfinite(sight.xyz[:, 2])
    assert known.sum() > 100
    np.testing.assert_allclose(points[known, :2] / points[known, 2:], sight.x[known], atol=2e-5)
    raw = view.normalise(SIFT.detect_and_describe(new.left, 800).uv)
    assert (np.abs(sight.x - raw).max() > 2 / FX) == (readout_s > 0)


def test_points_of_places_are_met_where_their_middle_rows_saw_them() -> None:
    """By three places that turn as fast as their tracks say."""
    view, rng = camera(READOUT_S), np.random.default_rng(1)
    setup, lens = setup_of(ModernMonocularConfig().build(Rig.single(view))), Lens(view, np.zeros(2))
    xyz = np.column_stack([rng.uniform((-2, -1.5), (2, 1.5), (60, 2)), rng.uniform(5, 9, 60)])
    places, seen = list[Keyframe](), list[np.ndarray]()
    for k, speed in enumerate(np.array([[150.0, 80.0], [-90.0, 120.0], [60.0, -150.0]])):
        pose = Pose(translation=np.array([0.2 * k, 0.1 * k, 0.0]))
        middle = view.project(pose.inverse().apply(xyz))
        rolled = middle + late_s(middle, READOUT_S) / (1 - view.line_delay_s * speed[1]) * speed
        moving = rolled[::3].astype(np.float32), np.tile(speed.astype(np.float32), (20, 1))
        place = Keyframe.of(k, pose.inverse(), (np.zeros((ROWS_PX, 320), np.uint8),), None)
        places.append(replace(place, moving=moving))
        seen.append(rolled)
    seen[0][0] = seen[1][0] = np.nan  # by the last one alone
    found = _triangulate(lens, places, seen, setup.noise.width)
    known = np.isfinite(found[:, 0])
    assert known[1:].all() and not known[0]
    np.testing.assert_allclose(found[1:], xyz[1:], rtol=2e-3, atol=2e-3)
    blind = [replace(place, moving=None) for place in places]
    bent = _triangulate(lens, blind, seen, setup.noise.width)
    assert np.nanmedian(np.linalg.norm(bent - xyz, axis=1)) > 0.1
    assert at_middle_row_of(lens.camera, blind[0], seen[0]) is seen[0]
