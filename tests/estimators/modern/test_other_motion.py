"""While a camera is followed, what moves by itself as one rigid thing is told, with its tracks."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.monocular.estimator import ModernMonocular, ModernMonocularConfig
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.tracks import (
    MAX_AGE,
    MIN_AGE,
    MIN_TRACKS,
    LiveTracks,
    MovedPoints,
    OutlierTracks,
    TrackingResult,
)
from ispom.estimators.modern.monocular.verify_map import find_other_motion
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.features.klt import Klt
from ispom.geometry import Pose
from ispom.types import Camera, Decision, Frame, Rig, Status, Step, TrackStatus
from tests.estimators.modern import waved_card
from tests.estimators.modern.waved_card import FX, SIZE, texture

SIGMA = 7e-4
CAMERA = Pose.from_rotvec(np.array([0.0, 0.02, 0.0]), np.array([0.3, 0.0, 0.1]))
"""world_from_camera of the frame; the key frame is the world."""
THING = Pose.from_rotvec(np.array([0.05, -0.08, 0.1]), np.array([-0.2, 0.5, 0.1]))
"""What becomes of its points in the world meanwhile."""
SCENE, MOVED = 200, 60


def seen(noise: float, astray: int = 0) -> tuple[Map, TrackedFrame]:
    """The map, and the tracks that disagree in the frame, of which the last few went astray."""
    rng = np.random.default_rng(3)
    scene = rng.uniform((-2, -1.5, 4), (2, 1.5, 9), (SCENE, 3))
    thing = rng.uniform((-0.6, -0.6, 3), (0.6, 0.6, 4), (MOVED, 3))
    before, after = np.concatenate([scene, thing]), np.concatenate([scene, THING.apply(thing)])
    x1, x2 = (p[:, :2] / p[:, 2:] for p in (before, CAMERA.inverse().apply(after)))
    x1, x2 = (x + rng.normal(0, 1, x.shape) * noise for x in (x1, x2))
    x2[SCENE + MOVED - astray :] += rng.uniform(-0.05, 0.05, (astray, 2))
    ids = np.arange(SCENE + MOVED)
    key = TrackedFrame(0, ids, x1, Pose())
    return Map((key,), ScenePoints(), None, SIGMA), TrackedFrame(1, ids[SCENE:], x2[SCENE:], CAMERA)


@pytest.mark.parametrize("noise", [0.0, 0.3 * SIGMA])
def test_a_thing_that_moves_by_itself_is_told_with_its_tracks(noise: float) -> None:
    world, frame = seen(noise)
    test, ids = find_other_motion(world, frame, SCENE, SIGMA)
    assert test is not None and not test.passed
    np.testing.assert_allclose(test.value, len(ids) / (SCENE + MOVED))
    assert set(ids) <= set(frame.ids) and len(ids) >= (1.0 if noise == 0 else 0.9) * MOVED


def test_tracks_gone_astray_are_not_among_them() -> None:
    world, frame = seen(0.3 * SIGMA, astray=15)
    test, ids = find_other_motion(world, frame, SCENE, SIGMA)
    assert test is not None and not test.passed
    assert np.isin(np.arange(SCENE, SCENE + MOVED - 15), ids).mean() > 0.9
    assert np.isin(np.arange(SCENE + MOVED - 15, SCENE + MOVED), ids).sum() <= 4


def test_nothing_is_told_of_tracks_that_all_went_astray() -> None:
    world, frame = seen(0.3 * SIGMA, astray=MOVED)
    test, ids = find_other_motion(world, frame, SCENE, SIGMA)
    assert test is not None and test.passed and test.value == 0.0 and not len(ids)


def test_what_stands_still_after_all_is_not_even_asked_about() -> None:
    world, frame = seen(0.3 * SIGMA)
    rng = np.random.default_rng(4)
    still = rng.uniform((-1, -1, 3), (1, 1, 6), (MOVED, 3))
    key = TrackedFrame(0, frame.ids, still[:, :2] / still[:, 2:], Pose())
    now = CAMERA.inverse().apply(still)
    frame = TrackedFrame(1, frame.ids, now[:, :2] / now[:, 2:], CAMERA)
    assert find_other_motion(Map((key,), ScenePoints(), None, SIGMA), frame, SCENE, SIGMA)[0] is None
    few = frame.without(frame.ids[15:])
    assert find_other_motion(world, few, SCENE, SIGMA)[0] is None, "too few"


def ended(uv: np.ndarray, count: int, most: int = 500) -> OutlierTracks:
    """The first `count` of the tracks at `uv` (N, 2) end: the first one is lost, the others are outliers."""
    status = np.full(len(uv), TrackStatus.ALIVE, np.uint8)
    status[:count:2], status[1:count:2], status[0] = TrackStatus.EPIPOLAR, TrackStatus.REPROJECTION, TrackStatus.LOST
    live = LiveTracks(ids=np.arange(len(uv)), uv=uv)
    return OutlierTracks().joined(live, TrackingResult(uv, status, np.zeros_like(uv)), most)


def test_what_ends_is_followed_on_and_given_up_where_nothing_explains_it() -> None:
    wide = texture(0, (240, 400))
    images = [np.ascontiguousarray(wide[:, 3 * i : 3 * i + 320]) for i in range(MAX_AGE + 4)]
    uv = np.random.default_rng(1).uniform((100, 20), (300, 220), (2 * MIN_TRACKS, 2)).astype(np.float32)
    ids = np.arange(len(uv))
    kept = ended(uv, len(ids))
    assert kept.ids.tolist() == ids[1:].tolist(), "not what was lost"
    assert ended(uv, len(ids), most=5).ids.tolist() == ids[-5:].tolist(), "the newest"
    assert not len(ended(uv, MIN_TRACKS).ids), "too few to be followed on"
    for i in range(1, MAX_AGE + 2):
        found = kept.expected
        now, status = Klt(max_forward_backward_px=np.inf).track(images[i - 1], images[i], found.before, found.now)
        kept = kept.after_tracking(images[i - 1], images[i], MovedPoints(found.before, now, status))
        if i < MIN_AGE:
            assert not kept.lasting.any()
        if i <= 10:
            np.testing.assert_allclose(kept.uv, uv[kept.ids] - [3.0 * i, 0], atol=0.3)
            assert (kept.lasting.sum() if i >= MIN_AGE else len(kept.ids)) >= len(ids) - 3
        if i == 10:
            kept = kept.explained(kept.ids[:4])
    assert 3 <= len(kept.ids) <= 4, "only what was explained"


def flown(frames: int, waved: bool) -> list[Step]:
    """A camera that moves past two walls, and a card before them that moves by itself or hangs still."""
    rig = Rig.single(Camera(SIZE[1], SIZE[0], FX, FX, SIZE[1] / 2, SIZE[0] / 2))
    estimator = ModernMonocular(rig, ModernMonocularConfig(max_tracks=300))
    state, steps = estimator.start(), []
    for i in range(frames):
        image = waved_card.seen(Pose(np.eye(3), np.array([1 - 0.05 * i, 0.0, 0.0])), i, waved)
        state, step = estimator.step(state, Frame.video(i * 50_000_000, image))
        steps.append(step)
    return steps


def _told(step: Step) -> Decision | None:
    return next((d for d in step.decisions if d.key == "second_motion" and not d.passed), None)


@pytest.mark.parametrize("waved", [True, False])
def test_a_card_that_is_waved_before_a_moving_camera_is_told_where_it_is(waved: bool) -> None:
    steps = [s for s in flown(40, waved) if s.status == Status.TRACKING]
    told = [s for s in steps if _told(s) is not None]
    assert len(steps) > 25
    assert len(told) >= 8 if waved else not told
    for step in told[2:]:
        tracks = step.other_motion["video"]
        assert len(tracks) >= 20
        off = np.abs(tracks.uv - [SIZE[1] / 2, SIZE[0] / 2 - 40])
        assert np.mean((off < 85).all(axis=1)) > 0.9
    assert all(not s.other_motion for s in steps if _told(s) is None)
