"""What moves by itself before a stereo pair as one rigid thing is told, with its points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereo, ModernStereoConfig
from ispom.estimators.modern.stereo.other_motion import other_motion
from ispom.estimators.modern.stereo.pair import PairPoints, TrackingResult
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.state import KeyFrame, ModernStereoState, StereoMap
from ispom.geometry import Pose
from ispom.solvers.localisation import fit_pose
from ispom.types import Camera, Decision, Frame, Rig, Step, TrackStatus
from tests.estimators.modern import waved_card
from tests.estimators.modern.setups import setup_of
from tests.estimators.modern.waved_card import FX, SIZE

BASELINE_M = 0.3
CAMERA = Camera(SIZE[1], SIZE[0], FX, FX, SIZE[1] / 2, SIZE[0] / 2)
ESTIMATOR = ModernStereo(
    Rig.of(left=CAMERA, right=CAMERA, rig_from_right=Pose(np.eye(3), np.array([BASELINE_M, 0.0, 0.0]))),
    ModernStereoConfig(),
)
LEFT = Pose.from_rotvec(np.array([0.0, 0.01, 0.0]), np.array([-0.1, 0.0, -0.05]))
"""left_from_world."""
THING = Pose.from_rotvec(np.array([0.02, -0.03, 0.05]), np.array([-0.1, 0.15, 0.05]))
"""What becomes of its points in the world meanwhile."""
SCENE, MOVED = 150, 50


def told(
    noise_px: float, thing: Pose, astray: int = 0, deeper: float = 1.0, keys: int = 0
) -> tuple[tuple[Decision, ...], set[int]]:
    """Returns the decisions about a pair, and the points that move. The last points move as a thing does, `astray` of
    them at random. The map has them at `deeper` times their depth, from `keys` keyframes."""
    rng, count = np.random.default_rng(0), SCENE + MOVED
    xyz = rng.uniform((-2, -1.5, 3), (2, 1.5, 8), (count, 3))
    now, before = LEFT.apply(np.concatenate([xyz[:SCENE], thing.apply(xyz[SCENE:])])), CAMERA.project(xyz)
    xyz[SCENE:] *= deeper
    uv = CAMERA.project(now) + noise_px * rng.standard_normal((count, 2))
    uv[count - astray :] += rng.uniform(-15, 15, (astray, 2))
    disparity = FX * BASELINE_M / now[:, 2] + noise_px * rng.standard_normal(count)
    all_points = np.arange(count)
    points = PairPoints(all_points, uv.astype(np.float32), disparity.astype(np.float32), np.zeros((len(uv), 2)))
    setup = setup_of(ESTIMATOR)
    located = fit_pose(xyz, points.seen_by(CAMERA), LEFT, setup.noise.width, setup.limit, setup.baseline_m)
    assert located is not None
    status = np.where(located.inliers, TrackStatus.ALIVE, TrackStatus.REPROJECTION).astype(np.uint8)
    lower = np.zeros(count, np.float32)
    sighting = TrackingResult(
        points.uv, points.disparity_px, points.slants, status, all_points, located, all_points, lower
    )
    key = KeyFrame(0, Pose(), all_points, np.zeros((count, 3)), np.zeros(12), np.zeros((count, 2)))
    last = LastPair(points=replace(points, uv=before.astype(np.float32)))
    state = ModernStereoState(last, StereoMap((key,) * keys, all_points, xyz))
    explained, _, tests = other_motion(setup, state, sighting, located)
    return tests, set(explained.tolist())


@pytest.mark.parametrize("noise_px", [0.0, 0.15])
def test_a_thing_that_moves_by_itself_is_told_with_its_points(noise_px: float) -> None:
    (test,), ids = told(noise_px, THING)
    assert not test.passed and ids <= set(range(SCENE, SCENE + MOVED))
    assert len(ids) >= (1.0 if noise_px == 0 else 0.9) * MOVED
    np.testing.assert_allclose(test.value, len(ids) / (SCENE + MOVED))


def test_points_gone_astray_are_not_among_them() -> None:
    (test,), ids = told(0.15, THING, astray=15)
    assert not test.passed and len(ids & set(range(SCENE + MOVED - 15, SCENE + MOVED))) <= 2
    assert len(ids) >= 0.85 * (MOVED - 15)
    (test,), ids = told(0.15, THING, astray=MOVED)
    assert test.passed and not ids, "all of them"


def test_of_what_stands_still_nothing_is_asked() -> None:
    assert told(0.15, Pose()) == ((), set())


def test_wrong_depths_are_no_motion_before_the_pair_has_been_adjusted() -> None:
    assert told(0.15, Pose(), deeper=3.0, keys=1) == ((), set())
    (test,), ids = told(0.15, Pose(), deeper=3.0, keys=2)
    assert not test.passed and len(ids) > 0.8 * MOVED, "later they are"
    (test,), ids = told(0.15, THING, keys=1)
    assert not test.passed and len(ids) > 0.6 * MOVED, "and what does move is told at once, where it is off its lines"


def flown(pairs: int, waved: bool) -> list[Step]:
    """A pair that moves past two walls, and a card before them that moves by itself or hangs still."""
    state, steps = ESTIMATOR.start(), []
    for i in range(pairs):
        left, right = (Pose(np.eye(3), np.array([1 - 0.05 * i - b, 0.0, 0.0])) for b in (0, BASELINE_M))
        pair = Frame.stereo(i * 100_000_000, waved_card.seen(left, i, waved), waved_card.seen(right, i, waved))
        state, step = ESTIMATOR.step(state, pair)
        steps.append(step)
    return steps


@pytest.mark.parametrize("waved", [True, False])
def test_a_card_that_is_waved_before_a_moving_pair_is_told_where_it_is(waved: bool) -> None:
    steps = flown(25, waved)
    told = [s for s in steps if any(d.key == "second_motion" and not d.passed for d in s.decisions)]
    assert len(told) >= 3 if waved else not told
    for step in told:
        tracks = step.other_motion["left"]
        off = np.abs(tracks.uv - [SIZE[1] / 2, SIZE[0] / 2 - 40])
        assert len(tracks) >= 20 and np.mean((off < 85).all(axis=1)) > 0.9
