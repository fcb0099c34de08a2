"""The verdicts of many gates on drawn pairs: where nothing changed, and where the error doubled."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from ispom_app.features.experiments.plan import Run
from ispom_app.features.experiments.row import Row
from ispom_app.features.gate.change import FAILED, change
from ispom_app.features.gate.judge import Judgement, Rules, judged
from ispom_app.features.gate.pairs import Pair
from ispom_app.features.gate.power import baseline_spread, grown, pairs_that_decide, power_of, smallest_growth
from numpy.typing import NDArray
from scipy.stats import norm

from ispom.geometry import Array
from tests.app.experiment.made import LINES, plan

Mask = NDArray[np.bool_]
A = LINES[0]
RULES = Rules(("ate_m",), math.log(1.01), 0.01, 1.0, None)
COUNT = 20
"""Gates of each kind."""
REPORTED = (13.7, 9.7, 6.6, 15.1, 0.55, 1.7, 0.38)
"""Ratios of seven seeds of `stereo` with `max_tracks: 60`."""


def judgement(logs: Array, failed: Mask | None = None, recovered: Mask | None = None, falls: Array | None = None):
    """The judgement of a line whose pairs have these logarithms, failures, and falls of localised frames [%]."""
    count = len(logs)
    none = np.zeros(count, bool)
    failed, recovered = none if failed is None else failed, none if recovered is None else recovered
    falls = np.zeros(count) if falls is None else falls
    pairs = []
    for seed in range(count):
        run = Run(A, "sim:tiny", seed)
        before = Row(run, "no motion") if recovered[seed] else Row(run, None, {"ate_m": 0.1, "located_percent": 95.0})
        values = {"ate_m": 0.1 * math.exp(logs[seed]), "located_percent": 95.0 - falls[seed]}
        after = Row(run, "no motion") if failed[seed] else Row(run, None, values)
        pairs.append(Pair(before, after, (Path("nowhere"), Path("nowhere"))))
    (found,) = judged(plan(lines=(A,), seeds=tuple(range(count))), pairs, RULES)
    return found


@pytest.fixture
def unplanned(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many pairs would decide takes most of the time, and is no part of a verdict."""
    monkeypatch.setattr("ispom_app.features.gate.judge.pairs_that_decide", lambda *_, **__: 2)


SCATTERS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "none": lambda rng, pairs: np.zeros(pairs),
    "rounding": lambda rng, pairs: rng.normal(0, 1e-4, pairs),
    "small": lambda rng, pairs: rng.normal(0, 0.02, pairs),
    "other noise": lambda rng, pairs: rng.normal(0, 0.5, pairs),
    "heavy tails": lambda rng, pairs: 0.3 * rng.standard_t(2, pairs),
    "rare blow-ups": lambda rng, pairs: (
        rng.normal(0, 0.05, pairs) + rng.choice([-2.5, 0, 2.5], pairs, p=[0.1, 0.8, 0.1])
    ),
}
"""Logarithms of ratios where a change does nothing: symmetric, as before and after can be exchanged."""


def gates(scatter: str, pairs: int, shift: float) -> Counter[str]:
    rng = np.random.default_rng([len(scatter), pairs])
    found: Counter[str] = Counter()
    for _ in range(COUNT):
        flips = rng.random((2, pairs)) < (0.05 if scatter in ("other noise", "heavy tails") else 0.0)
        falls = rng.normal(0, 2, pairs) if scatter == "heavy tails" else np.zeros(pairs)
        both = flips[0] & flips[1]
        logs = SCATTERS[scatter](rng, pairs) + shift
        found[judgement(logs, flips[0] & ~both, flips[1] & ~both, falls).verdict] += 1
    return found


@pytest.mark.usefixtures("unplanned")
@pytest.mark.parametrize("pairs", [7, 20])
@pytest.mark.parametrize("scatter", SCATTERS)
def test_of_twenty_unchanged_none_is_worse(scatter: str, pairs: int) -> None:
    found = gates(scatter, pairs, 0.0)
    assert found["worse"] == 0 and found["better"] <= 1, "better is said by chance in at most 1 % of the gates, too"
    assert (found["same"] == COUNT) == (scatter in ("none", "rounding")), (
        "what scatters more than the margin is unknown"
    )


@pytest.mark.usefixtures("unplanned")
@pytest.mark.parametrize("pairs", [7, 20])
@pytest.mark.parametrize("scatter", SCATTERS)
def test_of_twenty_with_twice_the_error_none_is_the_same_or_better(scatter: str, pairs: int) -> None:
    found = gates(scatter, pairs, math.log(2))
    assert found["same"] == found["better"] == 0
    if scatter in ("none", "rounding", "small"):
        assert found["worse"] == COUNT


def test_the_same_is_said_of_a_change_at_the_margin_as_rarely_as_the_level_allows() -> None:
    """The hardest case of equivalence: the change is the margin, and pairs scatter little."""
    rng = np.random.default_rng(7)
    logs = RULES.effect + rng.normal(0, 0.004, (400, 12))
    assert sum(change(row, RULES.effect, RULES.level).within(RULES.effect) for row in logs) <= 12
    inside = rng.normal(0, 0.004, (100, 20))
    assert sum(change(row, RULES.effect, RULES.level).within(RULES.effect) for row in inside) >= 95, "it can be said"


def test_the_reported_seeds_cannot_tell() -> None:
    found = judgement(np.log(REPORTED))
    assert found.verdict == "cannot tell" and found.reasons
    assert found.pairs_that_decide is not None and len(REPORTED) < found.pairs_that_decide <= 40
    assert found.seeds_that_decide == found.pairs_that_decide


def test_one_error_of_twenty_that_blows_up_is_not_the_same() -> None:
    logs = np.zeros(20)
    logs[3] = math.log(15)
    assert judgement(logs).verdict == "cannot tell"
    mostly_better = np.full(20, -0.05)
    mostly_better[3] = math.log(15)
    assert judgement(mostly_better).verdict == "cannot tell"


def test_failures_count_as_the_largest_errors() -> None:
    rng = np.random.default_rng(1)
    scatter, some, ten = rng.normal(0, 0.3, 10), np.arange(10) < 1, np.ones(10, bool)
    for failed, recovered in ((some, None), (None, some)):
        found: Judgement = judgement(scatter, failed, recovered)
        assert found.verdict == "cannot tell", "among runs that scatter, one failure may be chance"
    assert judgement(scatter, failed=ten).verdict == "worse"
    assert judgement(np.zeros(10), failed=some).verdict == "worse", "nothing scatters: it is no chance"
    assert judgement(np.zeros(10), recovered=some).verdict == "better"


def test_frames_that_are_lost_count() -> None:
    rng = np.random.default_rng(1)
    scatter, one = rng.normal(0, 0.3, 10), np.where(np.arange(10) == 4, 40.0, 0.0)
    assert judgement(np.full(10, -0.7), falls=np.full(10, 2.0)).verdict == "worse"
    assert judgement(np.zeros(10), falls=one).verdict == "worse"
    assert judgement(scatter, falls=one).verdict == "cannot tell"
    fewer = judgement(np.full(10, -0.7), falls=rng.normal(1, 2, 10))
    assert fewer.verdict == "cannot tell" and len(fewer.reasons) == 2, "a smaller error of fewer frames is no gain yet"


@pytest.mark.parametrize(("spread", "pairs"), [(0.05, 7), (0.3, 10), (0.5, 30)])
def test_the_stated_power_holds(spread: float, pairs: int) -> None:
    smallest = smallest_growth(pairs, spread, RULES.effect, RULES.level)
    assert smallest is not None
    logs = np.random.default_rng(11).normal(smallest, spread, (1000, pairs))
    assert grown(logs, RULES.effect, RULES.level).mean() == pytest.approx(0.8, abs=0.05)


def test_too_few_runs_find_nothing() -> None:
    assert smallest_growth(6, 0.1, RULES.effect, RULES.level) is None
    assert power_of("a", "ate_m", 6, None, "baseline", RULES.effect, RULES.level).source == "assumed"


@pytest.mark.parametrize(("shift", "spread", "verdicts"), [(0.15, 0.3, {"worse"}), (0.0, 0.008, {"same"})])
def test_so_many_runs_as_are_stated_decide(shift: float, spread: float, verdicts: set[str]) -> None:
    rng = np.random.default_rng(5)
    pilot = norm.ppf((np.arange(200) + 0.5) / 200, shift, spread)
    needed = pairs_that_decide(pilot, RULES.effect, RULES.level)
    assert needed is not None
    decided = [judgement(rng.normal(shift, spread, needed)).verdict in verdicts for _ in range(60)]
    assert 0.6 <= np.mean(decided) <= 0.97


def test_no_number_of_runs_decides_a_change_at_the_margin() -> None:
    rng = np.random.default_rng(5)
    logs = rng.normal(0, 0.01, 30)
    assert pairs_that_decide(logs - logs.mean() + RULES.effect, RULES.effect, RULES.level) is None
    assert pairs_that_decide(np.array([FAILED, *[0.0] * 9]), RULES.effect, RULES.level) is None


def test_the_scatter_of_a_baseline_is_that_within_a_source() -> None:
    rng = np.random.default_rng(2)
    rows = [
        Row(Run(A, source, seed), None, {"ate_m": scale * math.exp(rng.normal(0, 0.4))})
        for source, scale in (("sim:tiny", 1.0), ("sim:city", 100.0))
        for seed in range(200)
    ]
    assert baseline_spread(rows, "ate_m") == pytest.approx(0.4 * math.sqrt(2), rel=0.1)
    assert baseline_spread(rows[:1] + rows[-1:], "ate_m") is None
