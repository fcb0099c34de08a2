"""Cameras, rigs and trajectories."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.geometry import Pose
from ispom.types import Camera, Decision, GnssAntenna, GnssFix, Rig, TrackStatus, Trajectory, as_grey, colours_at
from tests import doubles

PLAIN = Camera(640, 480, 500.0, 510.0, 320.3, 239.1)
CAMERAS = [
    PLAIN,
    Camera(640, 480, 500.0, 510.0, 320.3, 239.1, (-0.28, 0.07, 1e-4, -2e-4)),
    Camera(640, 480, 500.0, 510.0, 320.3, 239.1, (-0.2, 0.05, 1e-4, 2e-5, 0.01)),
    Camera(752, 480, 458.6, 457.3, 367.2, 248.4, (0.1, 0.02, 0, 0, 0.01, 0.12, 0.03, 0.01)),
]


@pytest.mark.parametrize("camera", CAMERAS)
@given(u=st.floats(0, 639), v=st.floats(0, 479), depth=st.floats(0.1, 1000))
def test_projecting_undoes_normalising(camera: Camera, u: float, v: float, depth: float) -> None:
    x, y = camera.normalise(np.array([[u, v]]))[0]
    np.testing.assert_allclose(camera.project(depth * np.array([[x, y, 1.0]]))[0], [u, v], atol=1e-3)


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_is_opencvs(camera: Camera) -> None:
    points = np.random.default_rng(0).normal(size=(30, 3)) * (0.3, 0.3, 1) + (0, 0, 6)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    np.testing.assert_allclose(camera.project(points), expected.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_points_behind_have_no_image(camera: Camera) -> None:
    seen = camera.project(np.array([[0, 0, 1.0], [0, 0, -1.0], [1, 1, 0.0]]))
    assert np.isnan(seen).all(axis=1).tolist() == [False, True, True]
    assert camera.project(np.zeros((0, 3))).shape == camera.normalise(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("factor", [0.5, 0.25, 2.0, 0.3])
def test_a_scaled_camera_sees_the_scaled_image(factor: float) -> None:
    """Where the point is in the image that OpenCV resizes; pixel centres are at whole numbers."""
    scaled, points = PLAIN.scaled(factor), np.array([[0.3, -0.2, 2.0], [0, 0, 1.0]])
    expected = (PLAIN.project(points) + 0.5) * (scaled.width / 640, scaled.height / 480) - 0.5
    np.testing.assert_allclose(scaled.project(points), expected, atol=1e-9)
    image = np.zeros((480, 640), np.float32)
    cv2.circle(image, (200, 120), 40, 1.0, -1)
    small = cv2.resize(image, (scaled.width, scaled.height), interpolation=cv2.INTER_AREA)
    columns = small.sum(axis=0) @ np.arange(scaled.width) / small.sum()
    ray = PLAIN.normalise(np.array([[200.0, 120.0]]))[0]
    assert scaled.project(np.array([[*ray, 1.0]]))[0, 0] == pytest.approx(columns, abs=0.05)


def test_a_rectified_pair_is_centred_on_its_baseline() -> None:
    rig = Rig.stereo(PLAIN, 0.4)
    assert rig.baseline_m == pytest.approx(0.4) and rig.has_stereo
    np.testing.assert_allclose((rig.rig_from_left.translation + rig.rig_from_right.translation) / 2, 0)
    with pytest.raises(KeyError, match="video"):
        rig.camera("video")


def test_a_single_camera_is_the_rig() -> None:
    rig = Rig.single(PLAIN)
    assert not rig.has_stereo and rig.camera("video") == PLAIN
    np.testing.assert_array_equal(rig.rig_from("video").matrix, np.eye(4))


def test_a_trajectory_is_ordered_and_the_later_of_two_counts() -> None:
    second, other = (Pose(translation=np.array([x, 0, 0])) for x in (2.0, 3.0))
    trajectory = Trajectory.of([(20, second), (10, Pose()), (20, other)])
    assert trajectory.times_ns.tolist() == [10, 20]
    assert trajectory.translations[1, 0] == 3 and trajectory.length == 3
    found = trajectory.at(20)
    assert found is not None and found.translation[0] == 3 and trajectory.at(15) is None and trajectory.at(30) is None
    assert len(Trajectory.empty()) == 0 and Trajectory.of([]).xyzw.shape == (0, 4)


def test_moving_a_trajectory_moves_each_pose() -> None:
    left = Pose.from_rotvec(np.array([0.1, 0.2, 0.3]), np.array([1.0, 2, 3]))
    right = Pose.from_rotvec(np.array([-0.3, 0.2, 0.1]), np.array([0.1, 0, 3]))
    trajectory = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 10**9, 10**8)])
    moved = trajectory.moved(left, right, "video")
    for (_, pose), (_, expected) in zip(moved.items(), trajectory.items(), strict=True):
        np.testing.assert_allclose(pose.matrix, (left @ expected @ right).matrix, atol=1e-12)
    assert moved.frame == "video" and trajectory.moved().frame == "rig"


def test_a_trajectory_of_unequal_lengths_is_refused() -> None:
    with pytest.raises(ValueError, match="2 times"):
        Trajectory(np.array([1, 2]), np.zeros((1, 3, 3)), np.zeros((2, 3)))


def test_a_decision_reads_as_a_sentence() -> None:
    decision = Decision("parallax", 14.2, 20, False, "px", consequence="no key frame")
    assert str(decision) == "parallax 14.2 px >= 20 px: no (no key frame)"


def test_every_track_status_has_a_reason() -> None:
    assert len({status.reason for status in TrackStatus}) == len(TrackStatus)
    assert [s for s in TrackStatus if not s.dropped] == [TrackStatus.ALIVE, TrackStatus.NEW]


def test_colours_of_pixels() -> None:
    image = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    uv = np.array([[0.2, 0.4], [9, 9], [-5, 0]], np.float32)
    np.testing.assert_array_equal(colours_at(image, uv), image[[0, 1, 0], [0, 2, 0]])
    assert as_grey(image).shape == (2, 3) and colours_at(as_grey(image), uv).shape == (3, 3)


def test_a_sequence_can_be_cut() -> None:
    sequence = doubles.sequence().truncated(4)
    assert len(sequence) == len(sequence.kinds) == 4 and sequence[3].time_ns == sequence.times_ns[3]


def test_what_lies_beside_is_left_out_where_nobody_uses_it_and_comes_back() -> None:
    plain = doubles.sequence()
    fixes = [GnssFix(int(t) + 1, np.zeros(3), np.eye(3)) for t in plain.times_ns[::3]]
    rig = plain.rig.changed(gnss=GnssAntenna())
    asked = replace(plain, rig=rig).with_measurements(fixes)
    beside = replace(asked, beside=frozenset({"gnss"}))
    assert asked.used_by({"video"}) is asked, "what somebody asked for stays"
    found = beside.used_by({"video", "stereo"})
    assert found.kinds == plain.kinds and found.times_ns.tolist() == plain.times_ns.tolist()
    assert [found[i].time_ns for i in range(len(found))] == plain.times_ns.tolist()
    assert found.used_by({"video"}) is found and found.used_by({"gnss", "video"}) is beside
    assert len(found[2:5].used_by({"gnss"})) == 3, "a part has no more than itself"
