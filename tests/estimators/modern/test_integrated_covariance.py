"""What covariances of the integration take cameras to be off by."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.integrated.covariance import by_lens, variance_factors
from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.view import Noise
from ispom.estimators.modern.lens import corrected
from tests.solvers.made_flight import made_flight, problem_of


def test_places_change_with_the_lens_as_finite_differences_say() -> None:
    seen, eps = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 2)), 1e-6
    for i, found in enumerate(np.moveaxis(by_lens(seen), 2, 0)):
        difference = (corrected(seen, eps * np.eye(2)[i]) - seen) / eps
        np.testing.assert_allclose(found, difference, atol=1e-5)


def test_each_camera_is_as_noisy_as_its_method_found() -> None:
    rig = problem_of(made_flight(0.4, 4)).rig
    noise = Noise(0.13, 0.26, 0.26, 1.0)
    silent = ModernIntegratedState(JointWindow(rig, rig))
    assert variance_factors(noise, silent) == (1.0, 1.0)
    told = ModernIntegratedState(JointWindow(rig, rig), track_sigmas=(0.26, 0.13))
    assert variance_factors(noise, told) == pytest.approx((4.0, 0.25))
