"""The building blocks whose speed is measured: their sizes, the unit, and a process that fails. No time is asserted."""

from __future__ import annotations

import numpy as np

from ispom.solvers.window import adjustment
from tests.accuracy import blocks, child, unit


def test_the_window_has_the_configured_size() -> None:
    problem = blocks.bundle_window()
    assert len(problem.points) == 1000 and len(problem.rotations) == 10 and set(problem.cameras) == set(range(10))
    assert (np.diff(problem.owners) >= 0).all() and np.isfinite(problem.seen).all()
    found = adjustment.adjust(problem, 1 / 718)
    assert found.cost_after < 0.3 * found.cost_before and np.median(found.distances) < 1.5 / 718


def test_the_unit() -> None:
    own = unit.Unit()
    own.measure(1)
    assert own.ms > 0 and len(own._points) == unit.POINTS and own._a.shape[::-1] == unit.SIZE


def test_a_process_that_fails_says_so() -> None:
    assert "failed, please report it" in child.found("tests.accuracy.nothing", {})["error"]
