"""The integration where pairs are missing: what the video alone carries drifts, and the covariance says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.estimators.modern.integrated.report import DRIFT_SHARE, newest_covariance
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.types import Measurement, Sequence, Status, Step, is_stereo
from tests.alone import alone
from tests.estimators.modern.setups import setup_of

LAST = 3
"""Number of pairs that are kept; the video goes on for 1.7 s."""


def without_pairs(exposures: list[Measurement]) -> list[Measurement]:
    """Returns the measurements without the pairs after the first LAST ones, and without the video after these."""
    pairs = [e for e in exposures if is_stereo(e)]
    return [e for e in exposures if not is_stereo(e) or e.time_ns < pairs[LAST].time_ns]


@pytest.fixture(scope="module")
def walked(flight: Sequence, exposures: list[Measurement]) -> list[tuple[ModernIntegratedState, Step]]:
    estimator = alone("integrated", flight.rig)
    state, seen = estimator.start(), []
    for exposure in without_pairs(exposures):
        state, step = estimator.step(state, exposure)
        seen.append((state["integrated"], step))
    return seen


def test_positions_are_as_far_off_as_told_where_pairs_are_missing(
    flight: Sequence, walked: list[tuple[ModernIntegratedState, Step]]
) -> None:
    truth, steps = flight.truth, [step for _, step in walked]
    assert truth is not None
    first = next(s for s in steps if s.world_from_frame is not None)
    origin = truth.at(first.time_ns)
    assert origin is not None and first.world_from_frame is not None
    nees, last_ns = list[float](), steps[-1].time_ns
    for step in steps:
        true = truth.at(step.time_ns)
        if step.time_ns < last_ns - 700_000_000 or true is None:
            continue
        assert step.status is Status.TRACKING and step.world_from_frame is not None and step.covariance is not None
        error = (step.world_from_frame.inverse() @ first.world_from_frame @ origin.inverse() @ true).log()[:3]
        nees.append(float(error @ np.linalg.solve(step.covariance[:3, :3], error)))
    assert np.mean(nees) < 6


def test_what_is_told_grows_with_the_way_since_pairs_were_due(
    flight: Sequence, walked: list[tuple[ModernIntegratedState, Step]]
) -> None:
    state, step = walked[-1]
    setup = setup_of(ModernIntegratedConfig().build(flight.rig))
    window, reference, usual_ns = state.window, state.window.reference, state.window.usual_ns
    view = window.views[-1]
    assert reference is not None and usual_ns is not None
    # As if pairs were that far apart.
    far = replace(window.views[0], time_ns=window.views[0].time_ns - 10_000_000_000)
    soon = replace(state, window=replace(window, views=(far, *window.views[1:])))
    told, usual = newest_covariance(setup, state, step), newest_covariance(setup, soon, step)
    assert told is not None
    moved = np.linalg.norm((reference.world_from_rig.inverse() @ view.world_from_rig).translation)
    late = 1 - usual_ns / (view.time_ns - reference.time_ns)
    assert usual is not None and moved > 0.5
    np.testing.assert_allclose(np.diag(told - usual)[:3], (DRIFT_SHARE * late * moved) ** 2, rtol=1e-6)
