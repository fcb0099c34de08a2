"""Reports the corrections of self-calibration as decisions, and which of them are not observable."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.geometry import Array
from ispom.solvers.right_camera import BOTH, COLUMNS, PAIR, TERMS, by_column
from ispom.types import Check, Decision

SIDE = 0.5
"""x/z (27 degrees towards the sides of the image) at which the bend of the disparity offset is reported."""
OPEN = 0.7
"""A correction is not observable while its standard deviation exceeds this share of the prior's. The data then
contribute less information than the prior."""


def corrections(setup: Setup, world: StereoMap) -> tuple[Decision, ...]:
    """Returns the decisions about all estimated corrections; none without self-calibration."""
    if not setup.self_calibration or world.covariance is None:
        return ()
    covariance = world.covariance[-PAIR:, -PAIR:]
    sigma, before = np.sqrt(np.diag(covariance)), setup.extra_sigma
    made = [
        _correction(check, *(factor * v for v in (world.extra[i], sigma[i], before[i])))
        for i, (check, factor) in enumerate(zip(checks.CORRECTIONS, _factors(setup.camera.fx), strict=True))
        if before[i] > 0
    ]
    free = before > 0
    hidden = free & (sigma > OPEN * before)
    which = ", ".join(TERMS[i] for i in np.flatnonzero(hidden))
    told = f"not yet: {which}" if which else ""
    return (*made, _bend(setup, world, covariance), checks.OBSERVABLE.of((free & ~hidden).sum(), free.sum(), told))


def _factors(fx: float) -> Array:
    """Returns the factors (E,) from the units of right_camera.TERMS to those of the checks."""
    degree, one = float(np.degrees(1.0)), 1.0
    return np.array([one, one, fx, degree, degree, degree, 100.0, *[one] * 6, degree, 1e3, fx, degree])


def _correction(check: Check, value: float, sigma: float, before: float) -> Decision:
    """Compares a correction with two standard deviations of it."""
    spread = f"sigma {sigma:.2g}, prior {before:.2g} {check.unit}".rstrip()
    return check.of(value, 2 * sigma, spread, passed=bool(abs(value) > 2 * sigma))


def _bend(setup: Setup, world: StereoMap, covariance: Array) -> Decision:
    """Compares the disparity offset at both sides, relative to the centre, with two standard deviations of it."""
    sides = np.array([[SIDE, 0.0], [-SIDE, 0.0], [0.0, 0.0]])
    bend = setup.camera.fx * np.array([0.5, 0.5, -1.0]) @ by_column(sides, np.zeros(3))
    bend[:BOTH] = 0.0  # these corrections move far points alike in both images
    value = float(bend @ world.extra[:COLUMNS])
    twice = 2 * float(np.sqrt(bend @ covariance[:COLUMNS, :COLUMNS] @ bend))
    return checks.BEND.of(value, twice, passed=bool(abs(value) > twice))
