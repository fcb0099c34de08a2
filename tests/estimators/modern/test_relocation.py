"""A lost camera is found again by descriptors: in its old place and unit, or in a segment of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimator import Estimator
from ispom.estimators.modern.monocular import recover
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.keyframe import keep_frame_before_gap
from ispom.estimators.modern.monocular.localise import Localisation, is_contradicted
from ispom.estimators.modern.monocular.map import Map, TracksInMap
from ispom.estimators.modern.monocular.match_keyframes import MIN_INLIERS, depth_confirmed
from ispom.estimators.modern.monocular.tracks import LiveTracks, TrackingResult
from ispom.estimators.modern.monocular.window import prior_of_keyframes
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.tracked_frame import ScenePoints
from ispom.geometry import Pose
from ispom.solvers.localisation import PoseFit
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Camera, Frame, FrameName, Measurement, Rig, Sequence, Status, Step, Tracks, is_stereo, is_video
from tests.alone import alone, stepped_through
from tests.estimators.modern.setups import setup_of


def walked(
    estimator: Estimator,
    given: list[Measurement],
    taken_ns: list[int],
    flight: Sequence,
    camera: FrameName,
    before: int,
) -> tuple[list[Step], np.ndarray]:
    """The steps, and how far the final poses (N,) are from where the images were taken [m]: aligned by the first ones,
    nan without a pose."""
    state, steps = stepped_through(estimator, given)
    assert flight.truth is not None
    found, truth = estimator.finish(state), flight.truth.moved(right=flight.rig.rig_from(camera))
    error_m = np.full(len(given), np.nan)
    index = [i for i, exposure in enumerate(given) if found.at(exposure.time_ns) is not None]
    own = np.array([found.at(given[i].time_ns).translation for i in index])  # type: ignore[union-attr]
    true = np.array([truth.at(taken_ns[i]).translation for i in index])  # type: ignore[union-attr]
    first = np.array(index) < before
    onto = umeyama(own[first], true[first], with_scale=camera == "video")
    error_m[index] = np.linalg.norm(onto.apply(own) - true, axis=1)
    return steps, error_m


def stereo(
    flight: Sequence, exposures: list[Measurement], order: list[int], relocalise: bool = True
) -> tuple[list[Step], np.ndarray]:
    """Pairs in this order, at the times of a steady rig; negative ones upside down: another place."""
    pairs = [e for e in exposures if is_stereo(e)]
    every, given = pairs[1].time_ns - pairs[0].time_ns, list[Measurement]()
    for i, j in enumerate(order):
        images = pairs[abs(j)].left, pairs[abs(j)].right
        given.append(Frame.stereo(pairs[0].time_ns + i * every, *(v[::-1].copy() if j < 0 else v for v in images)))
    taken_ns = [pairs[abs(j)].time_ns for j in order]
    return walked(ModernStereoConfig(relocalise=relocalise).build(flight.rig), given, taken_ns, flight, "rig", 4)


def test_a_pair_after_a_gap_is_located_by_what_both_sides_show(flight: Sequence, exposures: list[Measurement]) -> None:
    steps, error_m = stereo(flight, exposures, [0, 1, 2, 3, 7])
    assert steps[-1].status is Status.TRACKING and not any(s.restarted for s in steps)
    assert error_m[-1] < 0.03, "of 1.9 m"
    assert len(steps[-1].residuals_px) > 40


def test_a_pair_that_a_turn_displaced_keeps_its_points(flight: Sequence, exposures: list[Measurement]) -> None:
    pairs = [e for e in exposures if is_stereo(e)]
    estimator = ModernStereoConfig().build(flight.rig)
    state = estimator.start()
    for pair in pairs[:4]:
        state, _ = estimator.step(state, pair)
    wrong = Pose.from_rotvec(np.radians([0.0, 20.0, 0.0]), np.zeros(3)) @ state.last.motion
    turned = replace(state, last=replace(state.last, motion=wrong))
    (_, step), (_, displaced) = (estimator.step(s, pairs[5]) for s in (state, turned))
    assert step.world_from_frame is not None and displaced.world_from_frame is not None
    assert len(displaced.residuals_px) > 0.9 * len(step.residuals_px), "patches are warped by where it is"
    off = displaced.world_from_frame.translation - step.world_from_frame.translation
    assert np.linalg.norm(off) < 0.005, "of 0.5 m"


def test_a_rig_that_was_carried_off_is_found_at_any_earlier_key_frame(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    steps, error_m = stereo(flight, exposures, [0, 1, 2, 3, 4, 5, 6, 7, -3, 0, 1])
    assert [s.status for s in steps[8:]] == [Status.LOST, Status.TRACKING, Status.TRACKING]
    assert not any(s.restarted for s in steps) and error_m[9:].max() < 0.03


def test_one_thing_that_stands_elsewhere_as_well_is_no_place(flight: Sequence, exposures: list[Measurement]) -> None:
    pairs = [e for e in exposures if is_stereo(e)]
    height, width = pairs[3].left.shape[:2]
    rows, columns = slice(height // 3, height // 2), np.arange(width // 5, width // 5 + width // 8)
    elsewhere = []
    for image, seen in ((pairs[7].left, pairs[3].left), (pairs[7].right, pairs[3].right)):
        elsewhere.append(image[::-1].copy())
        elsewhere[-1][rows, columns + width // 2] = seen[rows, columns]
    given = [*pairs[:4], pairs[4].with_images(left=elsewhere[0], right=elsewhere[1])]
    steps, _ = walked(
        ModernStereoConfig().build(flight.rig), list(given), [p.time_ns for p in pairs[:5]], flight, "rig", 4
    )
    assert steps[-1].status is Status.LOST and len(steps[3].residuals_px) > 40


def test_where_nothing_is_seen_again_a_segment_begins(flight: Sequence, exposures: list[Measurement]) -> None:
    steps, _ = stereo(flight, exposures, [0, 1, 2, 3, -4, -5, -6, -7])
    assert [i for i, s in enumerate(steps) if s.restarted] == [6]
    assert steps[-1].status is Status.TRACKING


def video(
    flight: Sequence, exposures: list[Measurement], order: list[int], relocalise: bool = True
) -> tuple[list[Step], np.ndarray]:
    """Frames in this order at a steady rate; negative ones upside down."""
    frames = [e for e in exposures if is_video(e)]
    images = [frames[abs(j)].image[::-1].copy() if j < 0 else frames[j].image for j in order]
    given = list[Measurement](Frame.video(frames[i].time_ns, image) for i, image in enumerate(images))
    taken_ns = [frames[abs(j)].time_ns for j in order]
    estimator = ModernMonocularConfig(relocalise=relocalise).build(flight.rig)
    return walked(estimator, given, taken_ns, flight, "video", 36)


def test_a_frame_after_a_gap_is_located_in_the_unit_of_before(flight: Sequence, exposures: list[Measurement]) -> None:
    steps, error_m = video(flight, exposures, [*range(36), *range(66, 72)])
    assert {s.status for s in steps[36:]} == {Status.TRACKING} and not any(s.restarted for s in steps)
    assert error_m[36:].max() < 0.05, "of 1.4 m"


def test_the_last_frame_before_a_gap_becomes_a_key_frame(flight: Sequence, exposures: list[Measurement]) -> None:
    """Tracks without a place get one by it, the poses stay; where no frame is missing nothing changes."""
    frames = [e for e in exposures if is_video(e)]
    estimator = ModernMonocularConfig().build(flight.rig)
    state = estimator.start()
    for frame in frames[:36]:
        state, _ = estimator.step(state, frame)
    setup, world, last_ns = setup_of(estimator), state.map, frames[35].time_ns
    assert world is not None and world.keys[-1].time_ns < last_ns
    for i in (36, 40):
        assert keep_frame_before_gap(setup, state, frames[i].time_ns) is state
    after = keep_frame_before_gap(setup, state, frames[41].time_ns)
    assert after.map is not None and after.map.keys[-1].time_ns == last_ns
    assert after.database.keyframes[-1].time_ns == last_ns
    assert keep_frame_before_gap(setup, after, frames[41].time_ns) is after
    before, now = (np.isfinite(m.known(state.live.ids)[:, 0]).sum() for m in (world, after.map))
    assert now > before + 20
    was, stays = estimator.finish(state), estimator.finish(after)
    assert was.times_ns.tolist() == stays.times_ns.tolist()
    np.testing.assert_allclose(stays.translations, was.translations, rtol=0, atol=1e-12)


def test_a_frame_that_keeps_few_of_its_tracks_is_located_by_descriptors_as_well(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    """43 tracks of 245 agree with a pose, all at one side: by them alone it was up to 12 cm off."""
    steps, error_m = video(flight, exposures, [*range(24), *range(62, 68)])
    assert {s.status for s in steps[24:]} == {Status.TRACKING} and not any(s.restarted for s in steps)
    assert error_m[24:].max() < 0.015, "of 1.9 m"
    assert next(d.value for d in steps[24].decisions if d.key == "described_points") > MIN_INLIERS


@pytest.mark.parametrize("more", [0, 1])
def test_one_thing_that_few_points_show_elsewhere_is_no_place(
    flight: Sequence, exposures: list[Measurement], more: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A strip of the last image: 31 points agree with a pose that nothing foretold, and `more` are needed."""
    monkeypatch.setattr(recover, "MIN_DESCRIBED", 31 + more)
    frames = [e for e in exposures if is_video(e)]
    height, width = frames[0].image.shape[:2]
    rows, columns = slice(height // 4, height * 5 // 12), np.arange(width // 12, width * 7 // 12)
    elsewhere = frames[66].image[::-1].copy()
    elsewhere[rows, columns + width // 3] = frames[35].image[rows, columns]
    estimator = ModernMonocularConfig(max_tracks=100).build(flight.rig)
    state = estimator.start()
    for frame in frames[:36]:
        state, step = estimator.step(state, frame)
        assert not step.restarted
    _, step = estimator.step(state, frames[36].with_images(video=elsewhere))
    assert next(d.value for d in step.decisions if d.key == "pose_points") == (0 if more else 31)
    assert step.status is (Status.LOST if more else Status.TRACKING)


def test_a_depth_counts_that_two_views_besides_speak_for() -> None:
    """Of a point on an epipolar line and one at infinity, from a camera, a view 1 m and a view 1 cm beside it."""
    xyz = np.array([[0.5, 0.2, 10.0], [300.0, 100.0, 1e5]])
    seen, hidden = np.ones(2, bool), np.zeros(2, bool)
    wide, wider, near = (Pose.from_rotvec(np.array([0, 0.1, 0.02]), np.array([x, 0, 0])) for x in (1.0, 2.0, 0.01))
    least = 0.008
    assert depth_confirmed(xyz, Pose(), [(wide, seen), (wider, seen)], least).tolist() == [True, True]
    assert depth_confirmed(xyz, Pose(), [(wide, seen), (near, seen)], least).tolist() == [False, True]
    assert depth_confirmed(xyz, Pose(), [(wide, seen), (wider, hidden), (near, seen)], least).tolist() == [False, True]
    assert depth_confirmed(xyz, Pose(), [(wide, seen), (wider, seen), (near, seen)], least).tolist() == [True, True]


def test_descriptors_are_no_argument_against_all_tracks_that_a_turn_left_in_sight() -> None:
    """Where most of what is in sight agrees to a fifth of a pixel, they may add to it, but not lead elsewhere."""
    rng = np.random.default_rng(2)
    rig = Rig.single(Camera(384, 288, 300.0, 300.0, 191.5, 143.5))
    setup, ids = setup_of(ModernMonocularConfig().build(rig)), np.arange(100)
    in_camera = np.column_stack([rng.uniform(-0.6, 0.6, 100), rng.uniform(-0.4, 0.4, 100), np.ones(100)])
    in_camera *= rng.uniform(15, 50, (100, 1))
    turn = Pose.from_rotvec(np.array([0.0, 0.6, 0.0]), np.zeros(3))
    shown = np.abs(turn.apply(in_camera)[:, 0]) < 0.55 * turn.apply(in_camera)[:, 2]
    assert 30 < shown.sum() < 50, "the turn takes others out of the image"
    world = Map((), ScenePoints(ids, in_camera), None, 1e-3)

    none = TrackingResult(np.zeros((0, 2), np.float32), np.zeros(0, np.uint8), np.zeros((0, 2), np.float32))

    def located(camera_from_world: Pose, use: np.ndarray) -> Localisation:
        near = turn.apply(in_camera[use])
        seen = near[:, :2] / near[:, 2:] + rng.normal(0, 0.2 / 300, (len(near), 2))
        fit = PoseFit(camera_from_world, np.zeros(len(near)), np.ones(len(near), bool), np.eye(6))
        return Localisation(none, np.zeros(0, bool), fit, ids[use], in_camera[use], seen)

    tracks, found = TracksInMap(setup, LiveTracks(ids=ids), world), located(turn, shown)
    near = located(Pose(turn.rotation, np.array([0.003, 0.0, 0.003])), shown)
    away = located(Pose(turn.rotation, np.array([0.1, 0.0, 0.0])), shown)
    assert not is_contradicted(tracks, found, near) and is_contradicted(tracks, found, away)
    few = shown & (np.cumsum(shown) <= 0.4 * shown.sum())
    assert not is_contradicted(tracks, located(turn, few), away), "on one thing that moves"
    assert not is_contradicted(tracks, replace(found, fit=None), away)


def test_a_camera_that_was_carried_off_is_found_at_any_earlier_key_frame(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    steps, error_m = video(flight, exposures, [*range(60), -30, -31, *range(14, 18)])
    assert [s.status for s in steps[60:]] == [*[Status.LOST] * 2, *[Status.TRACKING] * 4]
    assert not any(s.restarted for s in steps) and error_m[62:].max() < 0.05
    assert steps[62].key_frame, "only the map's adjustment says how sure it is of what a key frame showed long ago"


def test_a_start_from_a_turn_that_is_interrupted_is_a_segment_of_its_own(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    steps, _ = video(flight, exposures, [*[2] * 5, *range(-30, -60, -1)])
    assert [i for i, s in enumerate(steps) if s.restarted] == [5]
    assert steps[-1].status is Status.TRACKING


def test_a_camera_lost_for_long_goes_on_in_its_first_segment_where_that_is_seen_again(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    steps, error_m = video(flight, exposures, [*range(54), *[-30] * 8, *range(14, 20)])
    found = next(i for i, s in enumerate(steps) if i > 54 and s.status is Status.TRACKING)
    assert [s.status for s in steps[54:59]] == [Status.LOST] * 5 and found in (62, 63)
    assert all(s.world_from_frame is None for s in steps[54:found])
    assert not any(s.restarted or s.joins is not None for s in steps), "no other map was made meanwhile"
    assert {s.status for s in steps[found:]} == {Status.TRACKING}
    assert error_m[found:].max() < 0.05, "of 1.4 m"


def test_keyframes_found_again_hold_the_unit_and_leave_the_place_as_sure_as_it_was() -> None:
    poses = tuple(Pose.from_rotvec(np.array([0.0, 0.1 * i, 0.0]), np.array([0.01 * i, 0.0, 0.2])) for i in range(3))
    known = np.diag([0.01**2] * 3 + [0.002**2] * 3)
    prior = prior_of_keyframes(poses, np.zeros(2), known, 0.001, 5.0)
    covariance = np.linalg.inv(prior.hessian)
    np.testing.assert_allclose(covariance[:6, :6], known, atol=1e-9)
    # How the distance from the first to the last camera changes with left twists.
    along = poses[2].translation - poses[0].translation
    row = np.zeros(len(covariance))
    for i, sign in ((0, -1.0), (2, 1.0)):
        row[6 * i : 6 * i + 3] = -sign * poses[i].rotation.T @ along / (along @ along)
    scale_sigma = np.sqrt(row @ covariance @ row)
    # 0.02 of a baseline, at a depth of 5, of which a track of 0.001 leaves 0.005 open.
    assert scale_sigma == pytest.approx(0.005 / 0.02, rel=0.05)


def test_a_blind_start_of_stereo_is_told_by_the_integration_that_follows_it(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    begin_ns = [e for e in exposures if is_stereo(e)][3].time_ns
    ensemble, steps = alone("integrated", flight.rig), list[Step]()
    state = ensemble.start()
    for exposure in exposures:
        if exposure.time_ns > begin_ns:
            turned = {name: image[::-1].copy() for name, image in exposure.images.items()}
            exposure = exposure.with_images(**turned)  # noqa: PLW2901
        state, step = ensemble.step(state, exposure)
        steps.append(step)
    told = [(s.restarted, s.parts[0].restarted) for s in steps if isinstance(s.parts[0].tracks.get("left"), Tracks)]
    assert told.count((True, True)) == 1 and set(told) == {(True, True), (False, False)}


def test_a_pose_by_points_that_the_last_key_frame_did_not_see_is_no_surer_than_that() -> None:
    none = np.zeros((2, 3, 4)), np.zeros((4, 4)), np.zeros((2, 4))
    known = MapUncertainty((0,), np.arange(2), *none, 1.0, np.eye(6), 0, 0, 0, 0)
    xyz = np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5], [1, 1, 6]])
    motion = PoseFit(Pose(), np.zeros(4), np.ones(4, bool), np.eye(6))
    np.testing.assert_array_equal(known.of_pose(np.arange(10, 14), xyz, xyz[:, :2], motion, 0.001), np.eye(6))


def test_the_same_images_are_found_the_same(flight: Sequence, exposures: list[Measurement]) -> None:
    (a, _), (b, _) = (stereo(flight, exposures, [0, 1, 2, 3, 7]) for _ in range(2))
    assert a[-1].world_from_frame is not None and b[-1].world_from_frame is not None
    assert np.array_equal(a[-1].world_from_frame.matrix, b[-1].world_from_frame.matrix)


def test_without_relocalisation_it_is_plain_odometry(flight: Sequence, exposures: list[Measurement]) -> None:
    steps, _ = stereo(flight, exposures, [0, 1, 2, 3, 4, 5, 6, 7, -3, 0, 1], relocalise=False)
    assert [s.status for s in steps[8:10]] == [Status.LOST] * 2 and steps[10].restarted
    steps, _ = video(flight, exposures, [*range(60), -30, -31, *range(14, 18)], relocalise=False)
    assert [s.status for s in steps[60:62]] == [Status.LOST] * 2
