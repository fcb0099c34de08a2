"""Points that descriptors found are where patches are, in every key frame of the window."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.match_keyframes import KeyframeMatch, retriangulate
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Pose
from ispom.simulation.cameras import simulated_rig
from tests.estimators.modern.setups import setup_of

DEPTH, SHIFTS_PX = 5.0, (0, 6, 14)
"""Of a wall that the camera passes, and how far its image moved until each key frame."""
COUNT = 50
PLAIN = replace(simulated_rig(0.5).camera("video"), distortion=())

Wall = tuple[Setup, KeyframeDatabase, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def wall() -> Wall:
    """Key frames that see a wall, and some of its points (N, 3) and where the last one has them (N, 2) [px]."""
    random, width = np.random.default_rng(1), PLAIN.width
    paint = cv2.GaussianBlur(random.uniform(0, 255, (PLAIN.height, width + SHIFTS_PX[-1])), (0, 0), 1.5)
    paint = np.clip(4 * (paint - 127) + 127, 0, 255).astype(np.uint8)
    places = tuple(
        Keyframe.of(
            i, Pose(np.eye(3), np.array([-px * DEPTH / PLAIN.fx, 0, 0])), (paint[:, px : px + width].copy(),), None
        )
        for i, px in enumerate(SHIFTS_PX)
    )
    uv = np.column_stack([random.uniform(40, width - 40, COUNT), random.uniform(20, PLAIN.height - 20, COUNT)])
    rays = np.column_stack([PLAIN.normalise(uv), np.ones(COUNT)])
    setup = replace(setup_of(ModernMonocularConfig().build(simulated_rig(0.5))), camera=PLAIN)
    return setup, KeyframeDatabase(places), places[-1].camera_from_world.inverse().apply(DEPTH * rays), uv


def test_points_are_intersected_from_patches_in_all_key_frames_of_the_window(wall: Wall) -> None:
    (setup, places, xyz, uv), random = wall, np.random.default_rng(2)
    before, last = places.keyframes[0], places.keyframes[-1]
    keys = tuple(
        TrackedFrame(p.time_ns, np.zeros(0, np.int64), np.zeros((0, 2)), p.camera_from_world.inverse())
        for p in places.keyframes
    )
    guessed = last.camera_from_world.apply(xyz) * random.normal(1, 0.05, (COUNT, 1))
    views = (before, np.add(uv, (SHIFTS_PX[-1], 0)) + random.normal(0, 0.7, uv.shape)), (last, uv)
    world_from_camera = last.camera_from_world.inverse()
    given = KeyframeMatch(
        views, world_from_camera.apply(guessed), uv.astype(np.float32), world_from_camera, np.arange(len(uv))
    )
    found = retriangulate(setup, places, Map(keys, ScenePoints(), None, 1e-3), given)
    assert [p.time_ns for p, _ in found.views] == [0, 1, 2], "descriptors had compared two"
    for (_, at), px in zip(found.views[:2], SHIFTS_PX[:2], strict=True):
        off_px = np.linalg.norm(at - np.add(uv, (SHIFTS_PX[-1] - px, 0)), axis=1)
        assert np.isfinite(off_px).mean() > 0.9 and np.nanmedian(off_px) < 0.03, "of 0.8 px"
    off = last.camera_from_world.apply(found.xyz)[:, 2] / DEPTH - 1
    assert np.median(np.abs(off)) < 0.003, "of 3 %"


def test_where_another_key_frame_shows_something_else_it_stays_as_descriptors_say(wall: Wall) -> None:
    setup, places, xyz, uv = wall
    before, last = places.keyframes[0], places.keyframes[-1]
    other = replace(before, images=(before.images[0][::-1].copy(),))
    views = (other, np.add(uv, (SHIFTS_PX[-1], 0))), (last, uv)
    given = KeyframeMatch(views, xyz, uv.astype(np.float32), last.camera_from_world.inverse(), np.arange(len(uv)))
    found = retriangulate(setup, KeyframeDatabase((other, last)), Map((), ScenePoints(), None, 1e-3), given)
    same = (found.xyz == xyz).all(axis=1)
    assert same.mean() > 0.9
    np.testing.assert_array_equal(found.views[0][1][same], views[0][1][same])
