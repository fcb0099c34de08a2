"""The loss of the monocular map is as wide as its tracks' errors are, and what it weighs stays in balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.monocular.map import NARROWEST, WIDTH_IN_MEDIANS, Map
from ispom.estimators.modern.monocular.window import anchored_prior
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Pose

WIDEST = 2e-3


def world(spread: float) -> Map:
    """Two keyframes. `spread`: residuals of the points of the last window, in widths of its loss."""
    none = np.zeros(0, np.int64), np.zeros((0, 2))
    keys = tuple(TrackedFrame(i, *none, Pose(np.eye(3), np.array([i, 0.0, 0.0]))) for i in range(2))
    poses, lens = tuple(k.world_from_camera for k in keys if k.world_from_camera), np.array([3e-3, 1e-2])
    prior = anchored_prior(poses, lens, 1e-4 * np.eye(6), 0.01)
    return Map(keys, ScenePoints(), prior, WIDEST / 2, extra_sigma=lens, noise=TrackNoise(spread=spread))


@pytest.mark.parametrize(("spread", "wanted"), [(0.25, 0.25 / 2 * WIDTH_IN_MEDIANS), (4.0, 1.0), (0.0, NARROWEST)])
def test_it_is_some_median_distances_wide_but_no_wider_than_wanted(spread: float, wanted: float) -> None:
    assert world(spread).with_loss(WIDEST).loss == pytest.approx(wanted * WIDEST)


@pytest.mark.parametrize("spread", [0.1, 0.5])
def test_what_is_known_besides_stays_as_sure_beside_the_tracks(spread: float) -> None:
    before = world(spread)
    after = before.with_loss(WIDEST)
    assert after.loss != before.loss and before.prior is not None and after.prior is not None
    np.testing.assert_allclose(before.prior.hessian * before.loss**2, after.prior.hessian * after.loss**2, rtol=1e-9)
    np.testing.assert_allclose(before.extra_sigma / before.loss, after.extra_sigma / after.loss)
    again = replace(after, noise=TrackNoise(spread=1 / WIDTH_IN_MEDIANS)).with_loss(WIDEST)
    assert again.loss == pytest.approx(after.loss), "errors that fit it change nothing"
