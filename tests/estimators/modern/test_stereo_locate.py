"""A pair is located by what most of its points say, also where some near ones are found at the wrong place."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.localise import PoseProblem
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.state import ModernStereoState, StereoMap
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig
from tests.estimators.modern.setups import setup_of

CAMERA, BASELINE_M, NOISE_PX = Camera(1280, 960, 920.0, 920.0, 640.0, 480.0), 0.4, 0.08
SETUP = setup_of(ModernStereoConfig().build(Rig.stereo(CAMERA, BASELINE_M)))
TRUE = Pose.from_rotvec(np.array([0.01, 0.07, -0.02]), np.array([-0.1, -0.07, -1.0]))
"""left_from_world."""
FAR, NEAR = 130, 26


def seen_from(pose: Pose, xyz: Array) -> Array:
    """(N, 3) as KeyFrame.seen."""
    q = pose.apply(xyz)
    return np.column_stack([q[:, :2] / q[:, 2:], (q[:, 0] - BASELINE_M) / q[:, 2]])


@pytest.mark.parametrize("off", [(-0.12, -0.04, 0.14), (0.2, 0.0, 0.0), (0.0, 0.0, -0.25)])
def test_a_road_that_looks_the_same_everywhere_does_not_lead_astray(off: tuple[float, float, float]) -> None:
    """Points on it are found where the prediction puts them, 55 px beside their place."""
    rng = np.random.default_rng(0)
    far = rng.uniform((-30, -15, 20), (30, 10, 80), (FAR, 3))
    road = np.column_stack([rng.uniform(-2, 2, NEAR), np.full(NEAR, 1.6), rng.uniform(4, 5, NEAR)])
    wrong = Pose(np.eye(3), np.array(off)) @ TRUE
    xyz = np.concatenate([far, road])
    seen = np.concatenate([seen_from(TRUE, far), seen_from(wrong, road)])
    seen += NOISE_PX / CAMERA.fx * rng.standard_normal(seen.shape)
    world = StereoMap(ids=np.arange(len(xyz)), xyz=xyz)
    last = LastPair(left_from_world=Pose(), time_ns=0)
    problem = PoseProblem(SETUP, ModernStereoState(last, world), np.arange(len(xyz)), seen, 333_000_000)
    found, _ = problem.solved(wrong)
    assert found is not None
    assert np.linalg.norm((found.camera_from_world @ TRUE.inverse()).translation) < 0.02
    assert found.inliers[:FAR].all() and not found.inliers[FAR:].any()
