"""The covariance of a pair that is no key frame: located by a window's points, of which it tells nothing new."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.state import KeyFrame, StereoMap
from ispom.estimators.modern.stereo.window import with_frame_covariance
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.adjustment import Window, adjust
from ispom.solvers.window.prior import anchored
from ispom.types import Camera, Rig
from tests.estimators.modern.setups import setup_of
from tests.estimators.modern.test_noise import flown
from tests.nees import band

ERROR, SCALE, BASELINE, FX = 1e-3, 5e-3, 0.3, 100.0
SETUP = setup_of(
    ModernStereoConfig(self_calibration=False, loss_px=SCALE * FX).build(
        Rig.stereo(Camera(640, 480, FX, FX, 319.5, 239.5), BASELINE)
    )
)
KINDS = {
    "alike": {"new": ERROR, "step": 0.0, "disparity": ERROR},
    "walk": {"new": 0.3 * ERROR, "step": ERROR, "disparity": 0.3 * ERROR},
}


def views(window: Window, keep: int) -> Window:
    """Its first views, and the points that two of them see."""
    mine = window.cameras < keep
    seen = np.bincount(window.owners[mine], minlength=len(window.points)) >= 2
    mine &= seen[window.owners]
    return replace(
        window,
        rotations=window.rotations[:keep],
        translations=window.translations[:keep],
        points=window.points[seen],
        cameras=window.cameras[mine],
        owners=(np.cumsum(seen) - 1)[window.owners[mine]],
        seen=window.seen[mine],
        factors=window.factors[mine],
    )


def located(points: Array, seen: Array, guess: Pose) -> Pose:
    """From points (N, 3) as if they were exact."""

    def errors(twist: Array) -> Array:
        near = (Pose.exp(twist) @ guess).apply(points)
        uvr = np.column_stack([near[:, :2], near[:, 0] - BASELINE]) / near[:, 2:]
        return ((uvr - seen) / SCALE).ravel()

    return Pose.exp(least_squares(errors, np.zeros(6), loss="cauchy").x) @ guess


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_that_of_the_errors(kind: str) -> None:
    nees = []
    for seed in range(24):
        whole = flown(seed, KINDS[kind], BASELINE)
        last = len(whole.rotations) - 1
        kept = np.bincount(whole.owners[whole.cameras < last], minlength=len(whole.points)) >= 2
        ids, window = np.flatnonzero(kept), views(replace(whole, fixed=0), last)
        prior = anchored(whole.rotations[0], whole.translations[0], np.zeros(PAIR))
        done = adjust(replace(window, prior=prior), SCALE, 30, 1e-8).window
        keys = [
            KeyFrame(i, Pose(r, t), ids[done.owners[at]], done.seen[at], np.zeros(12), np.zeros((len(at), 2)))
            for i, (r, t) in enumerate(zip(done.rotations, done.translations, strict=True))
            if len(at := np.flatnonzero(done.cameras == i))
        ]
        world = StereoMap(tuple(keys), ids, done.points, prior=prior, newest=np.eye(6))
        mine = (whole.cameras == last) & kept[whole.owners]
        owners, seen, true = whole.owners[mine], whole.seen[mine], Pose(whole.rotations[last], whole.translations[last])
        pose = located(done.points[np.searchsorted(ids, owners)], seen, true)
        pair = KeyFrame(last, pose, owners, seen, np.zeros(12), np.zeros((len(owners), 2)))
        covariance = with_frame_covariance(SETUP, world, pair).newest_covariance
        assert covariance is not None
        off = (pose @ true.inverse()).log()
        nees.append(off @ np.linalg.solve(covariance, off))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high
