"""The map that a run leaves: every point once, at its latest place, and only key frames that have a final pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ispom_app.run.map_memory import MapCollectors

from ispom.types import Landmarks, Step, TrackStatus, Trajectory, VideoFrame
from tests import doubles

BLACK = np.zeros((60, 80), np.uint8)


def steps(count: int) -> list[Step]:
    estimator, state, found = doubles.FakeEstimator("monocular"), (), []
    for i in range(count):
        state, step = estimator.step(state, VideoFrame(i * 10**8, BLACK))
        found.append(step)
    return found


def test_the_latest_place_counts_and_nan_none() -> None:
    memories, run = MapCollectors(), steps(2)
    nowhere = Landmarks(np.array([0, 900]), np.full((2, 3), np.nan), np.zeros((2, 3), np.uint8))
    for step in (*run, replace(run[1], landmarks=nowhere)):
        memories.add((step,))
    trajectory = Trajectory.of([(s.time_ns, doubles.pose_at(s.time_ns)) for s in run], "video")
    found = memories.scenes({"monocular": trajectory}, ("monocular",), doubles.rig())["monocular"].landmarks
    first, second = (s.landmarks for s in run)
    assert found.ids.tolist() == list(range(31))
    np.testing.assert_array_equal(found.xyz_in_world[0], first.xyz_in_world[0])
    np.testing.assert_array_equal(found.xyz_in_world[1:], second.xyz_in_world)
    np.testing.assert_array_equal(found.rgb[1:], second.rgb)


def test_key_frames_with_a_final_pose_and_their_living_tracks() -> None:
    memories, run, rig = MapCollectors(), steps(11), doubles.rig()
    for step in run:
        memories.add((step,))
    rig_poses = Trajectory.of([(s.time_ns, doubles.pose_at(s.time_ns)) for s in run[:10]])
    found = memories.scenes({"monocular": rig_poses}, ("monocular",), rig)["monocular"]
    assert found.key_frames.times_ns.tolist() == [0, 5 * 10**8] and found.key_frames.frame == "video"
    expected = doubles.pose_at(5 * 10**8) @ rig.rig_from_video
    np.testing.assert_allclose(found.key_frames.pose(1).matrix, expected.matrix, atol=1e-12)
    tracks = run[5].tracks["video"]
    np.testing.assert_array_equal(found.seen_ids[found.seen_from == 1], tracks.ids[tracks.status < TrackStatus.LOST])


def test_a_method_that_never_spoke_has_an_empty_map() -> None:
    found = MapCollectors().scenes({"stereo": Trajectory.empty()}, ("stereo",), doubles.rig())["stereo"]
    assert not len(found.landmarks) and not len(found.key_frames) and not len(found.seen_ids)
