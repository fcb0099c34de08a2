"""New points of a key frame are where its adjustment leaves pose and pair, not where they were thought to be before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.localise import LocalisedFrame
from ispom.estimators.modern.stereo.map import extend_map
from ispom.estimators.modern.stereo.pair import PairPoints, StereoImages, TrackingResult
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import K1, PAIR, TERMS, by_column
from ispom.types import Camera, Rig
from tests.estimators.modern.setups import setup_of

CAMERA, BASELINE_M = Camera(640, 480, 460.0, 460.0, 319.5, 235.0), 0.4
COUNT, FRESH = 300, 150


def observed(xyz: Array, left_from_world: Pose, ids: NDArray[np.int64], k1: float) -> PairPoints:
    """Of points of the world, by a pair whose right lens is off by `k1`."""
    near = left_from_world.apply(xyz[ids])
    perfect = np.column_stack([near[:, :2], near[:, 0] - BASELINE_M]) / near[:, 2:]
    wrong = by_column(perfect[:, [2, 1]], perfect[:, 0] - perfect[:, 2])[:, K1] * k1
    uv = CAMERA.project(near).astype(np.float32)
    disparity_px = CAMERA.fx * (perfect[:, 0] - perfect[:, 2] - wrong)
    return PairPoints(ids, uv, disparity_px.astype(np.float32), np.zeros((len(ids), 2)))


def test_fresh_points_have_the_pose_and_the_pair_that_the_adjustment_found() -> None:
    setup = setup_of(ModernStereoConfig().build(Rig.stereo(CAMERA, BASELINE_M)))
    rng, k1 = np.random.default_rng(0), 0.02
    ahead = np.column_stack([rng.uniform(-0.6, 0.6, COUNT), rng.uniform(-0.45, 0.45, COUNT), np.ones(COUNT)])
    xyz, ids = ahead * rng.uniform(3, 15, (COUNT, 1)), np.arange(COUNT)
    state, nothing, image = ModernStereoState(LastPair()), PairPoints(), np.zeros((480, 640), np.uint8)
    for i in range(4):
        pose = Pose.from_rotvec(np.array([0.0, 0.02 * i, 0.01 * i]), np.array([-0.3 * i, 0.05 * i, -0.2 * i]))
        # Where a pair that is taken for perfect is thought to be.
        thought = Pose(translation=np.array([0.01, 0.02, -0.03]) * (i > 0)) @ pose
        old, new = (nothing, ids[:FRESH]) if i == 0 else (observed(xyz, pose, ids[:FRESH], k1), ids[:0])
        new = ids[FRESH:] if i == 3 else new
        frame = LocalisedFrame(StereoImages(i * 10**8, image, image), thought, old, np.zeros(12))
        state, _, _ = extend_map(setup, state, frame, observed(xyz, pose, new, k1), TrackingResult.nothing())
    found = state.map
    assert abs(found.extra[K1] - k1) < 0.003, dict(zip(TERMS, found.extra, strict=True))
    fresh = found.places(ids[FRESH:])
    assert len(found.extra) == PAIR and (fresh >= 0).all()
    near = found.keys[-1].left_from_world.apply(found.xyz[fresh])
    true = observed(xyz, pose, ids[FRESH:], 0.0)
    disparity = BASELINE_M / near[:, 2]
    np.testing.assert_allclose(CAMERA.fx * disparity, true.disparity_px, atol=0.35)
    np.testing.assert_allclose(CAMERA.project(near), true.uv, atol=0.05)
