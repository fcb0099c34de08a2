"""Sensors left out of the window of `fused`: the truth is what comes out where nothing is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ispom.solvers.influence.blame import Blame, blame
from ispom.solvers.influence.problem import collecting_problems
from ispom.types import Frame, Status, Step
from tests.estimators.survey.test_fused import EXACT, Run, chosen, config

pytest.importorskip("gtsam")


def last_blame(scheme: str, **changed: Any) -> Blame:
    """Of the last node of the run."""
    run, found = Run(config(scheme), chosen(scheme, **changed)), None
    state = run.estimator.start()
    for m in run.measurements:
        shown = isinstance(m, Frame)
        inputs = {"visual": Step(m.time_ns, Status.TRACKING, "video", run.images[m.time_ns])} if shown else {}
        with collecting_problems() as heard:
            state, _ = run.estimator.step(state, m, inputs)
        found = heard[-1] if heard else found
    assert found is not None
    return blame(found)


def test_no_sensor_that_is_right_moved_the_pose() -> None:
    found = last_blame("2")
    assert {each.part.name for each in found.of("sensor")} == {"images", "IMU", "GNSS"}
    assert all(each.shift.size < 0.05 for each in found.influences)


def test_fixes_that_are_wrong_moved_the_pose_from_where_the_others_have_it() -> None:
    jump = replace(EXACT["gnss"], jump_m=0.3, jump_from_s=5.0, jump_until_s=6.0)
    right, wrong = last_blame("2"), last_blame("2", gnss=jump)
    moved = wrong.problem.pose.translation - right.problem.pose.translation
    first = next(each for each in wrong.influences if each.part.name == "GNSS")
    assert np.linalg.norm(moved) > 0.01
    np.testing.assert_allclose(first.shift.position, moved, atol=0.2 * float(np.linalg.norm(moved)))
    assert wrong.problem.really(first.part).size == pytest.approx(first.shift.size, rel=0.05)
