"""The integration after a cut: some seconds of darkness, then another place, which nothing joins to the first one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Frame, Measurement, Sequence, Status, Step, Trajectory, is_stereo
from tests.alone import Alone, alone, stepped_through

LIGHT_S, DARK_S, OTHER_S = 1.4, 1.5, 1.4


def dark(exposure: Measurement, number: int) -> Measurement:
    """The same exposure under a cap: the sensor's noise alone."""

    def image(of: np.ndarray) -> np.ndarray:
        light = np.random.default_rng((number, of.size)).normal(12, 2, of.shape)
        return np.clip(light, 0, 255).astype(np.uint8)

    if is_stereo(exposure):
        return Frame.stereo(exposure.time_ns, image(exposure.left), image(exposure.right))
    return exposure.with_images(video=image(exposure.image))


@pytest.fixture(scope="module")
def other(flight: Sequence, rendered: Path) -> Sequence:
    found = open_simulated("tiny", 2, rendered, duration_s=OTHER_S)
    assert found.rig.baseline_m == flight.rig.baseline_m
    return found


@pytest.fixture(scope="module")
def cut(flight: Sequence, other: Sequence) -> list[Measurement]:
    start = int(flight.times_ns[0])
    first = [flight[i] for i in range(len(flight)) if flight.times_ns[i] - start < LIGHT_S * 1e9]
    under = [flight[i] for i in range(len(flight)) if flight.times_ns[i] - start < DARK_S * 1e9]
    later, last = int(LIGHT_S * 1e9), int((LIGHT_S + DARK_S) * 1e9)
    return [
        *first,
        *(replace(dark(e, i), time_ns=e.time_ns + later) for i, e in enumerate(under)),
        *(replace(other[i], time_ns=int(other.times_ns[i]) + last) for i in range(len(other))),
    ]


@pytest.fixture(scope="module")
def gone_through(flight: Sequence, cut: list[Measurement]) -> tuple[Alone, dict, list[Step]]:
    estimator = alone("integrated", flight.rig)
    state, steps = stepped_through(estimator, cut)
    return estimator, state, steps


def error_m(found: Trajectory, truth: Trajectory, later_ns: int) -> float:
    """The largest, relative to the pose in the middle."""
    true = [truth.at(int(t) - later_ns) for t in found.times_ns]
    middle = len(found) // 2
    origin = true[middle]
    assert origin is not None and len(found) > 20
    onto = origin @ found.pose(middle).inverse()
    errors = [(onto @ found.pose(i)).translation - p.translation for i, p in enumerate(true) if p is not None]
    return float(np.linalg.norm(errors, axis=1).max())


def test_another_place_after_the_dark_is_a_segment_and_nothing_is_bent_to_meet_it(
    flight: Sequence, other: Sequence, gone_through: tuple[Alone, dict, list[Step]]
) -> None:
    estimator, state, steps = gone_through
    dark_ns, light_ns = (int(flight.times_ns[0] + s * 1e9) for s in (LIGHT_S, LIGHT_S + DARK_S))
    begun = [s for s in steps if s.restarted]
    assert len(begun) == 1 and begun[0].time_ns >= light_ns and begun[0].status is Status.TRACKING
    between = [s for s in steps if dark_ns <= s.time_ns < begun[0].time_ns]
    assert {s.status for s in between} == {Status.LOST}
    assert all(s.status is Status.TRACKING for s in steps if s.time_ns > begun[0].time_ns)
    found = estimator.finish(state)
    assert flight.truth is not None and other.truth is not None
    before, after = found.times_ns < dark_ns, found.times_ns >= begun[0].time_ns
    assert (before | after).all()
    assert error_m(found.select(before), flight.truth, 0) < 0.03
    assert error_m(found.select(after), other.truth, int((LIGHT_S + DARK_S) * 1e9)) < 0.06
