"""The places by which a lost camera is found again: bounded, and all of them compared in turn."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.keyframe_database import CANDIDATES, MAX_KEYFRAMES, RECENT, Keyframe, KeyframeDatabase
from ispom.estimators.modern.verification import plausible
from ispom.features.sift import SIFT
from ispom.geometry import Pose


def place(time_ns: int, size: tuple[int, int] = (24, 32)) -> Keyframe:
    image = np.random.default_rng(time_ns).integers(0, 255, size).astype(np.uint8)
    return Keyframe.of(time_ns, Pose(), (image,), None)


def many(count: int) -> KeyframeDatabase:
    places = KeyframeDatabase()
    for i in range(count):
        places = places.with_keyframe(place(100 * i))
    return places


def test_places_are_bounded_and_thinned_evenly() -> None:
    times = [p.time_ns for p in many(5 * MAX_KEYFRAMES).keyframes]
    assert len(times) == MAX_KEYFRAMES and times == sorted(times)
    assert times[0] == 0, "the first is kept: where one begins one often returns to"
    assert times[-RECENT:] == [100 * i for i in range(5 * MAX_KEYFRAMES - RECENT, 5 * MAX_KEYFRAMES)]
    older = np.diff(times[:-RECENT])
    assert older.max() <= 3 * older.min() + 100 * RECENT


def test_the_newest_is_compared_first_and_all_in_turn() -> None:
    places, image = many(10), place(300).images[0]
    first = places.query(image, 0)
    assert first[0].time_ns == 900 and first[1].time_ns == 300 and len(first) == 1 + CANDIDATES
    compared = {p.time_ns for turn in range(5) for p in places.query(image, turn)}
    assert compared == {p.time_ns for p in places.keyframes}
    assert not KeyframeDatabase().query(image, 0)


def test_wide_images_are_kept_small_and_their_features_stand_where_the_camera_sees_them() -> None:
    small = np.random.default_rng(0).integers(0, 255, (40, 100)).astype(np.uint8)
    wide = np.kron(small, np.ones((16, 16), np.uint8))
    found = Keyframe.of(0, Pose(), (wide,), None).described(SIFT)
    assert found.images[0].shape == (320, 800) and found.features is not None
    assert found.features.uv[:, 0].max() > 1400
    np.testing.assert_allclose(found.reduced(np.array([[799.5, 319.5]])), [[399.5, 159.5]])


def test_poses_are_revised() -> None:
    moved = Pose(np.eye(3), np.ones(3))
    places = many(3).with_poses({100: moved})
    assert [p.camera_from_world.translation[0] for p in places.keyframes] == [0.0, 1.0, 0.0]


def test_a_pose_far_off_or_agreed_upon_by_few_is_none() -> None:
    agreeing, depth = np.arange(20) < 12, np.full(20, 10.0)
    assert plausible(agreeing, depth, depth + 5).sum() == 12
    assert not plausible(agreeing, depth, depth + 140).any(), "from there all points are one"
    assert not plausible(np.arange(20) < 4, depth, depth).any(), "so few agree by chance"
