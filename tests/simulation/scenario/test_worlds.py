"""Motions and places that images alone cannot measure: that they are what they are called."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.simulation.cameras import NOISE_SIGMA, simulated_rig
from ispom.simulation.motions import MOTIONS, SLOWER, motion_of
from ispom.simulation.places.walls import TILE_M
from ispom.simulation.source import PLACES, Source

TIMES_NS = np.arange(0, 10_000_000_000, 333_333_333)


def test_pure_rotation_keeps_the_centre_of_the_video_camera() -> None:
    motion, video = motion_of("rotation", 4), simulated_rig().rig_from_video
    poses = [motion.pose_at(int(t)) @ video for t in TIMES_NS]
    np.testing.assert_allclose([p.translation for p in poses], [poses[0].translation] * len(poses), atol=1e-12)
    turned = [np.degrees(np.linalg.norm((poses[0].inverse() @ p).rotvec)) for p in poses]
    assert max(turned) > 20


def test_standing_still_is_one_pose() -> None:
    motion = motion_of("still", 4)
    assert all(np.array_equal(motion.pose_at(int(t)).matrix, motion.pose_at(0).matrix) for t in TIMES_NS)


def test_tiny_steps_are_the_flight_fifty_times_slower() -> None:
    slow, flight = motion_of("tiny-steps", 4), motion_of("flight", 4)
    for t in TIMES_NS:
        np.testing.assert_array_equal(slow.pose_at(int(t)).matrix, flight.pose_at(round(SLOWER * int(t))).matrix)
    places = [[slow.pose_at(int(t) + dt).translation for dt in (0, 33_333_333)] for t in TIMES_NS]
    assert np.linalg.norm(np.diff(places, axis=1), axis=2).max() < 0.003


def test_sideways_looks_at_the_wall_and_moves_along_it() -> None:
    motion = motion_of("sideways", 4)
    poses = [motion.pose_at(int(t)) for t in TIMES_NS]
    assert poses[-1].translation[0] - poses[0].translation[0] > 10
    assert all(abs(p.translation[2]) < 1.5 and p.rotation[2, 2] > np.cos(np.radians(20)) for p in poses)


@pytest.mark.parametrize("name", MOTIONS)
def test_every_motion_is_smooth(name: str) -> None:
    motion = motion_of(name, 1)
    for t in TIMES_NS:
        step = motion.pose_at(int(t)).inverse() @ motion.pose_at(int(t) + 1_000_000)
        assert np.linalg.norm(step.log()) < 0.02


def image(place: str, time_ns: int = 0, motion: str = "sideways", right_late_ns: int = 0, kind: str = "video"):
    return Source(1, False, 0.25, place, motion, right_late_ns).render(time_ns, kind, 1)  # type: ignore[arg-type]


def test_the_blank_wall_shows_noise_and_nothing_else() -> None:
    seen = image("blank").astype(float)
    assert seen.std(axis=(0, 1)) == pytest.approx([NOISE_SIGMA] * 3, rel=0.1)


def test_the_wall_has_texture_and_the_tiles_repeat() -> None:
    assert image("wall").std() > 8
    surfaces = PLACES["tiles"](1).surfaces
    u = np.linspace(100.01, 100.4, 50, dtype=np.float32)
    w, face = np.full(50, 0.01, np.float32), np.zeros(50, np.intp)
    one, other = (surfaces.colour(2, face, u + k * np.float32(TILE_M), 0 * u + 3, w, w) for k in (0, 8))
    np.testing.assert_allclose(one, other, atol=2.0)
    assert one.std() > 3


def test_a_right_camera_that_is_late_shows_the_later_moment() -> None:
    late = image("city", 0, "flight", 40_000_000, "stereo")
    half = len(late) // 2
    now, then = image("city", 0, "flight", 0, "stereo"), image("city", 40_000_000, "flight", 0, "stereo")
    assert np.array_equal(late[:half], now[:half])
    difference = [np.abs(late[half:].astype(float) - other[half:]).mean() for other in (then, now)]
    assert difference[0] < 2 * NOISE_SIGMA < difference[1]


def test_a_drive_is_level_and_looks_where_it_goes() -> None:
    drive, ms = motion_of("drive", 4), 1_000_000
    for time_ns in range(0, 6_000 * ms, 500 * ms):
        pose, later = drive.pose_at(time_ns), drive.pose_at(time_ns + ms)
        ahead = (later.translation - pose.translation) / np.linalg.norm(later.translation - pose.translation)
        assert np.allclose(pose.rotation[:, 1], [0, 1, 0]) and pose.translation[1] == -1.75
        assert np.allclose(pose.rotation[:, 2], ahead, atol=1e-3)
