"""The map that a run leaves: it agrees with the final poses, and has only keyframes that have one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ispom_app.engine.model.map_memory import MapCollectors

from ispom.types import Frame, Landmarks, Step, Tracks, TrackStatus, Trajectory, WorldLines
from tests import doubles

BLACK = np.zeros((60, 80), np.uint8)


def steps(count: int) -> list[Step]:
    estimator, state, found = doubles.FakeEstimator("monocular"), (), []
    for i in range(count):
        state, step = estimator.step(state, Frame.video(i * 10**8, BLACK))
        found.append(step)
    return found


def walked(count: int, xyz: np.ndarray) -> tuple[list[Step], Trajectory]:
    """Keyframes that see the points exactly but put them where poses of a drifting world would, and the true poses."""
    rig, camera = doubles.rig(), doubles.rig().camera("video")
    poses = Trajectory.of([(i * 10**8, doubles.pose_at(i * 10**8)) for i in range(count)])
    found = []
    for i, step in enumerate(steps(count)):
        uv = camera.project((poses.pose(i) @ rig.rig_from_video).inverse().apply(xyz))
        tracks, ids = Tracks.of(np.arange(len(xyz)), uv), np.arange(len(xyz))
        drifting = Landmarks(ids, (1 + i) * xyz + 3.0, np.full((len(xyz), 3), i, np.uint8))
        found.append(replace(step, key_frame=True, tracks={"video": tracks}, landmarks=drifting))
    return found, poses


def cloud() -> np.ndarray:
    return np.random.default_rng(2).uniform((-3, -2, 8), (3, 2, 14), (40, 3))


def test_landmarks_lie_where_the_final_poses_put_them_not_where_they_once_were() -> None:
    memories, (run, poses) = MapCollectors(), walked(8, cloud())
    for step in run:
        memories.add((step,))
    found = memories.scenes({"monocular": poses}, ("monocular",), doubles.rig())["monocular"].landmarks
    assert found.ids.tolist() == list(range(40)) and (found.rgb == 7).all()
    np.testing.assert_allclose(found.xyz_in_world, cloud(), rtol=1e-3)


def test_points_of_an_integration_have_the_names_that_its_part_gave_them() -> None:
    """Its own landmarks are named apart by camera: even the video's, odd the pairs'."""
    memories, (run, poses) = MapCollectors(), walked(8, cloud())
    for part in run:
        named = replace(part.landmarks, ids=2 * part.landmarks.ids)
        memories.add((replace(part, method="integrated", tracks={}, landmarks=named, parts=(part,)),))
    found = memories.scenes({"integrated": poses}, ("integrated",), doubles.rig())["integrated"]
    assert found.landmarks.ids.tolist() == list(range(40)) and set(found.seen_ids) == set(range(40))
    np.testing.assert_allclose(found.landmarks.xyz_in_world, cloud(), rtol=1e-3)


def test_tracks_that_the_method_never_placed_are_no_landmarks() -> None:
    memories, (run, poses) = MapCollectors(), walked(8, cloud())
    for step in run:
        few, nowhere = step.landmarks, step.landmarks.xyz_in_world.copy()
        nowhere[10:] = np.nan
        memories.add((replace(step, landmarks=replace(few, xyz_in_world=nowhere)),))
    found = memories.scenes({"monocular": poses}, ("monocular",), doubles.rig())["monocular"].landmarks
    assert found.ids.tolist() == list(range(10))


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


def test_the_last_known_lines_are_kept_while_a_method_is_lost() -> None:
    memories, (run, poses) = MapCollectors(), walked(3, cloud())
    early, late = (WorldLines(np.full((count, 2, 3), 1.5), np.arange(count)) for count in (1, 2))
    for step, lines in zip(run, (early, late, WorldLines.empty()), strict=True):
        memories.add((replace(step, world_lines=lines),))
    found = memories.scenes({"monocular": poses}, ("monocular",), doubles.rig())["monocular"].lines
    assert found.group.tolist() == [0, 1]
