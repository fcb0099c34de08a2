"""Faults of times: how many, which, and what the truth says then."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.simulation.scenario.fault import Clock, Dropped, Repeated
from ispom.types import Sequence
from tests import doubles
from tests.simulation.scenario.conftest import video


def test_dropped_frames_are_exactly_the_share_and_never_the_first(plain: Sequence) -> None:
    found = Dropped(share=0.25).on(plain, 0)
    assert found.kinds.count("video") == 60 - round(0.25 * 59) and found.kinds.count("stereo") == 6
    assert found.times_ns[0] == plain.times_ns[0] and set(found.times_ns) < set(plain.times_ns)
    for i in range(len(found)):
        assert found[i].time_ns == found.times_ns[i]


def test_dropped_within_a_spell_only(plain: Sequence) -> None:
    found = Dropped(share=0.5, from_s=1.0).on(plain, 0)
    assert (found.times_ns < 10**9).sum() == (plain.times_ns < 10**9).sum()


def test_a_repeated_frame_has_the_pixels_of_the_one_before_and_its_own_time(plain: Sequence) -> None:
    found = Repeated(share=0.3).on(plain, 1)
    same = [np.array_equal(video(found, n).image, video(found, n - 1).image) for n in range(1, 60)]
    assert sum(same) == round(0.3 * 59)
    assert [video(found, n).time_ns for n in range(60)] == [video(plain, n).time_ns for n in range(60)]


@pytest.mark.parametrize(("late_s", "drift"), [(0.02, 0.0), (-0.015, 0.0), (0.0, 0.01), (0.004, -0.02)])
def test_the_clock_is_late_and_drifts_as_stated(plain: Sequence, late_s: float, drift: float) -> None:
    found = Clock(late_s=late_s, drift=drift).on(plain, 0)
    assert (np.diff(found.times_ns) > 0).all() and found.truth is not None
    frames = [i for i, kind in enumerate(found.kinds) if kind == "video"]
    for n, i in enumerate(frames):
        really_s = n / 30
        assert found.times_ns[i] * 1e-9 == pytest.approx(really_s - late_s - drift * really_s, abs=2e-9)
        truth = found.truth.at(int(found.times_ns[i]))
        assert truth is not None
        np.testing.assert_array_equal(truth.matrix, doubles.pose_at(round(n / 30 * 1e9)).matrix)
        assert np.array_equal(found[i].image, video(plain, n).image)  # type: ignore[union-attr]
