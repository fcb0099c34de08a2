"""Shares of a made error are those that were put in, and shares and rest make the whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.evaluation.budget.budget import (
    LEVEL,
    Budget,
    Cause,
    Share,
    fall_m2,
    mean_share,
    noise_share,
    share_of,
)
from ispom.evaluation.budget.scale import scale_part_m2
from ispom.evaluation.trajectory_error import Alignment, TrajectoryError
from ispom.geometry import Array
from ispom.types import Trajectory
from tests.doubles import pose_at

COUNT = 200
TIMES_NS = np.arange(COUNT) * 50_000_000
TRUE = Trajectory.of([(int(t), pose_at(int(t))) for t in TIMES_NS])


def off_by(errors_m: Array, kind: Alignment = "none") -> TrajectoryError:
    return TrajectoryError(replace(TRUE, translations=TRUE.translations + errors_m), TRUE, kind)


def noise(rng: np.random.Generator, sigma_m: float) -> Array:
    return sigma_m * rng.normal(size=(COUNT, 3))


def test_shares_and_rest_make_the_squared_error() -> None:
    causes = (
        Cause("calibration", "rerun", Share(0.04, 0.03, 0.05)),
        Cause("clock", "rerun", Share(0.01, -0.02, 0.04)),
        Cause("outliers", "rerun", unknown="nothing to leave out"),
    )
    budget = Budget("stereo", "se3", 0.3, COUNT, causes)
    assert budget.rest.value_m2 == pytest.approx(0.09 - 0.05)
    assert budget.rest.half_m2 == pytest.approx(np.hypot(0.01, 0.03))
    assert sum(c.share.value_m2 for c in causes if c.share) + budget.rest.value_m2 == pytest.approx(0.09)


def test_the_fall_is_that_over_the_poses_that_both_have() -> None:
    """A rerun that lost the frames with the large errors is no better for that."""
    errors = np.zeros((COUNT, 3))
    errors[:50, 0], errors[50:, 0] = 5.0, 0.3
    before, after = off_by(errors), off_by(np.full((COUNT, 3), [0.1, 0, 0]))
    part = replace(after, estimate=after.estimate.select(slice(50, None)), reference=TRUE.select(slice(50, None)))
    assert fall_m2(before, part) == pytest.approx(0.3**2 - 0.1**2)
    few = replace(after, estimate=after.estimate.select(slice(150, None)), reference=TRUE.select(slice(150, None)))
    assert fall_m2(before, few) is None


def test_a_share_that_is_known_no_better_than_by_the_whole_error_is_none() -> None:
    assert Cause("noise", "", Share.around(0.02, 0.0099)).told(0.1).share == Share.around(0.02, 0.0099)
    vague = Cause("noise", "", Share.around(0.02, 0.0101)).told(0.1)
    assert vague.share is None and vague.unknown and vague.name == "noise"


def test_intervals_need_repetitions() -> None:
    assert (
        share_of(1.0, []) is None
        and mean_share([1.0]) is None
        and noise_share(off_by(np.zeros((COUNT, 3))), []) is None
    )


@pytest.mark.parametrize("repeats", [1, 3, 5])
def test_an_interval_of_repetitions_holds_as_often_as_it_says(repeats: int) -> None:
    rng, count = np.random.default_rng(repeats), 4000
    held = 0
    for fall, *repeated in rng.normal(1.0, 0.2, (count, repeats + 1)):
        # What scatters are the repetitions about the run, by as much as the run about the truth.
        share = share_of(fall, [fall + each - 1.0 for each in repeated])
        assert share is not None
        held += share.contains(1.0)
    assert held / count == pytest.approx(LEVEL, abs=0.02)


def test_an_interval_of_equal_ways_holds_for_a_further_one() -> None:
    rng, count = np.random.default_rng(3), 4000
    draws = rng.normal(1.0, 0.2, (count, 4))
    shares = [mean_share(list(draw[:3])) for draw in draws]
    held = sum(share is not None and share.contains(draw[3]) for share, draw in zip(shares, draws, strict=True))
    assert held / count == pytest.approx(LEVEL, abs=0.02)


def test_the_share_of_noise_is_found_beside_another_error() -> None:
    """The noise of a run differs from that of the noisier ones, and meets the other error by chance."""
    held, shares = 0, []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        other, own = np.cumsum(noise(rng, 0.01), axis=0), noise(rng, 0.1)
        run = off_by(other + own)
        share = noise_share(run, [off_by(other + own + noise(rng, 0.1)) for _ in range(4)])
        assert share is not None
        held += share.contains(run.ate_m**2 - off_by(other).ate_m ** 2)
        shares.append(share.value_m2)
    assert np.mean(shares) == pytest.approx(3 * 0.1**2, rel=0.02)
    assert held / 300 >= LEVEL


def test_the_part_of_the_scale_of_a_metric_path_is_all_of_a_scaled_one() -> None:
    scaled = TrajectoryError(replace(TRUE, translations=1.05 * TRUE.translations), TRUE, "se3")
    assert scale_part_m2(scaled) == pytest.approx(scaled.ate_m**2)
    assert scale_part_m2(off_by(np.zeros((COUNT, 3)), "se3")) == pytest.approx(0.0, abs=1e-12)


def test_the_part_of_the_scale_of_another_path_is_its_drift() -> None:
    drift = np.exp(np.linspace(0, 0.2, COUNT - 1))[:, None]
    steps = np.diff(TRUE.translations, axis=0) * drift
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    drifting = TrajectoryError(replace(TRUE, translations=3 * path), TRUE, "sim3")
    part = scale_part_m2(drifting)
    assert part is not None and part == pytest.approx(drifting.ate_m**2, rel=0.05)
    short = TrajectoryError(TRUE.select(slice(20)), TRUE.select(slice(20)), "sim3")
    assert scale_part_m2(short) is None
