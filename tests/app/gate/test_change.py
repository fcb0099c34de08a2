"""The statistics of a gate: exact cases, false alarms on data without a change, and power for a loss of 3 %."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ispom_app.features.gate.change import change, pairs_needed, probability_of_growth
from scipy.stats import binom

LOSS = math.log(1.03)
EFFECT = math.log(1.01)
LEVEL = 0.01
GATES = 400
"""Simulated gates per property."""


def test_what_did_not_change_is_no_change() -> None:
    found = change(np.zeros(20), EFFECT, LEVEL)
    assert (found.same, found.estimate, found.low, found.high) == (20, 0.0, 0.0, 0.0)
    assert found.p_worse == 1.0 and found.p_better == 1.0


@pytest.mark.parametrize("pairs", [7, 20, 60])
def test_a_loss_of_3_percent_in_every_pair_is_found(pairs: int) -> None:
    found = change(np.full(pairs, LOSS), EFFECT, LEVEL)
    assert found.p_worse <= LEVEL < found.p_better and found.estimate == pytest.approx(LOSS)
    gain = change(np.full(pairs, -LOSS), EFFECT, LEVEL)
    assert gain.p_better == found.p_worse and gain.p_worse == found.p_better


def test_the_p_of_few_pairs_is_exact() -> None:
    found = change(np.array([0.02, 0.03, 0.05, 0.07, 0.11]), 0.0, 0.05)
    assert found.p_worse == pytest.approx(2**-5) and found.p_better == 1.0


@pytest.mark.parametrize(("level", "tests"), [(0.01, 1), (0.01, 3), (0.05, 4), (0.1, 1)])
def test_fewer_pairs_than_needed_show_nothing(level: float, tests: int) -> None:
    needed = pairs_needed(level, tests)
    ratios = LOSS * (1 + np.arange(needed) / 10)
    assert change(ratios, 0.0, level).p_worse * tests <= level
    assert change(ratios[:-1], 0.0, level).p_worse * tests > level


def test_the_estimate_is_that_of_hodges_and_lehmann() -> None:
    logs = np.random.default_rng(3).normal(0.02, 0.05, 21)
    i, j = np.triu_indices(21)
    assert change(logs, 0.0, LEVEL).estimate == pytest.approx(np.median((logs[i] + logs[j]) / 2), abs=1e-9)


@given(st.lists(st.integers(-500, 500).map(lambda n: n / 1000), min_size=8, max_size=30))
@settings(max_examples=30, deadline=None, derandomize=True)
def test_exchanging_before_and_after_mirrors_all(values: list[float]) -> None:
    logs = np.array(values)
    one, other = change(logs, EFFECT, LEVEL), change(-logs, EFFECT, LEVEL)
    assert one.p_worse == other.p_better and one.p_better == other.p_worse
    assert one.estimate == pytest.approx(-other.estimate, abs=1e-6)
    if one.low is not None and one.high is not None:
        assert other.high is not None and one.low == pytest.approx(-other.high, abs=1e-9)
        assert one.low - 1e-9 <= one.estimate <= one.high + 1e-9


@given(
    st.floats(1e-4, 0.5),
    st.integers(7, 70),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["normal", "laplace", "flip"]),
)
@settings(max_examples=6, deadline=None, derandomize=True)
def test_false_alarms_are_as_rare_as_the_level(spread: float, pairs: int, seed: int, kind: str) -> None:
    """Also where nothing is of no interest: the hardest case. 1 in a million such properties would fail by chance."""
    rng = np.random.default_rng(seed)
    logs = {
        "normal": lambda: rng.normal(0, spread, (GATES, pairs)),
        "laplace": lambda: rng.laplace(0, spread, (GATES, pairs)),
        "flip": lambda: spread * rng.choice([-1.0, 1.0], (GATES, pairs)) * rng.uniform(0.9, 1.1, (GATES, pairs)),
    }[kind]()
    alarms = sum(probability_of_growth(row, 0.0) <= LEVEL for row in logs)
    assert alarms <= binom.ppf(1 - 1e-6, GATES, LEVEL)


@pytest.mark.parametrize(("spread", "pairs", "power"), [(0.005, 9, 0.99), (0.02, 20, 0.95), (0.04, 60, 0.9)])
def test_a_loss_of_3_percent_is_found(spread: float, pairs: int, power: float) -> None:
    logs = np.random.default_rng(49).normal(LOSS, spread, (GATES, pairs))
    assert np.mean([probability_of_growth(row, EFFECT) <= LEVEL for row in logs]) >= power


@pytest.mark.parametrize("pairs", [10, 60])
def test_the_interval_holds_the_change(pairs: int) -> None:
    logs = np.random.default_rng(5).normal(LOSS, 0.02, (100, pairs))
    bounds = [(c.low, c.high) for row in logs for c in [change(row, EFFECT, LEVEL)]]
    assert sum(low <= LOSS <= high for low, high in bounds if low is not None and high is not None) >= 94
