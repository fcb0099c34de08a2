"""The parts of an audit: blocks, corrections, samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.evaluation.audit.blocks import levels, residuals
from ispom.evaluation.audit.correction import UNDONE, Convention, Correction, outside, shifted_ns, undone
from ispom.evaluation.audit.samples import Path, clocks_at, samples_at
from ispom.geometry import Pose, rotation_angle_rad
from ispom.solvers.trajectory.alignment import umeyama
from tests.evaluation.audit.made_paths import noisy, path

BACK: dict[Convention, Convention] = {"w-first": "w-last", "w-last": "w-first"}
"""What undoes a convention that is not its own inverse."""


@pytest.mark.parametrize("name", UNDONE)
def test_a_convention_is_undone(name: Convention) -> None:
    true = path(1, seconds=5)
    again = undone(undone(true, (BACK.get(name, name),)), (name,))
    assert again.translations == pytest.approx(true.translations)
    assert rotation_angle_rad(np.swapaxes(again.rotations, 1, 2) @ true.rotations).max() < 1e-6


@pytest.mark.parametrize("with_scale", [False, True])
def test_blocks_are_aligned_as_by_themselves(with_scale: bool) -> None:
    true, own = path(2), noisy(path(2))
    for starts in levels(len(true)):
        found = residuals(own.translations, true.translations, starts, with_scale)
        ends = np.append(starts[1:], len(true))
        for first, end in zip(starts, ends, strict=True):
            a, b = own.translations[first:end], true.translations[first:end]
            assert found[first:end] == pytest.approx(umeyama(a, b, with_scale).apply(a) - b, abs=1e-9)


def test_corrections_follow_one_another() -> None:
    true = path(3, seconds=5)
    first = Correction(("inverse",), (), Pose.from_rotvec(np.array([0.1, 0.2, 0]), np.ones(3)), offset_s=0.5)
    second = Correction((), (), Pose.from_rotvec(np.array([0, 0.3, 0]), np.array([0, 1.0, 0])), 1.0, -0.25)
    both, once = first.then(second).of_estimate(true), second.of_estimate(first.of_estimate(true))
    assert both.translations == pytest.approx(once.translations) and (both.times_ns == once.times_ns).all()


@given(st.integers(0, 2 * 10**18), st.floats(-1e6, 1e6), st.floats(0.5, 2))
def test_clocks_turn_about_the_first_pose(first_ns: int, offset_s: float, rate: float) -> None:
    times = first_ns + np.array([0, 10**9, 5 * 10**9])
    found = shifted_ns(times, rate, offset_s)
    assert found[0] - first_ns == round(offset_s * 1e9)
    assert np.diff(found) * 1e-9 == pytest.approx(rate * np.array([1, 4]), rel=1e-6)


def test_stretches_have_open_ends() -> None:
    times = np.arange(5, dtype=np.int64) * 10**9
    assert outside(times, ((1.0, 2.0),)).tolist() == [True, False, False, True, True]
    assert outside(times, ((3.0, np.inf), (-np.inf, 0.0))).tolist() == [False, True, True, False, False]


def test_nothing_is_interpolated_over_a_gap() -> None:
    true = path(4, seconds=10)
    gappy = true.select((true.times_ns < 3e9) | (true.times_ns > 6e9))
    own, other = Path.of(true, 0, True), Path.of(gappy, 0, True)
    times, good = clocks_at(own, other)
    assert not good[(times > 3.01) & (times < 6)].any() and good[times < 2.9].all()
    samples = samples_at(own, other, times[good])
    assert samples.own == pytest.approx(samples.true, abs=1e-6)
