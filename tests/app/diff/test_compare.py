"""The comparison itself, on rows that are made: what differs, where first, by how much."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ispom_app.engine.differences.compare import Compared, MethodRow, distance, divergences

from ispom.geometry import Pose

METHODS = ("monocular", "stereo")
KEYS = ("alive", "status", "key_frame", "tracks_digest", "position")
VALUES = {
    "alive": st.integers(0, 999),
    "status": st.sampled_from(("tracking", "lost")),
    "key_frame": st.booleans(),
    "tracks_digest": st.text("0123456789abcdef", min_size=16, max_size=16),
    "position": st.tuples(*[st.floats(-9, 9)] * 3),
}
SAID = st.fixed_dictionaries({key: VALUES[key] | st.none() for key in KEYS})


@st.composite
def runs(draw: st.DrawFn) -> list[MethodRow]:
    """Each frame is stepped on by some of the methods."""
    found = []
    for exposure in range(draw(st.integers(1, 8))):
        for method in draw(st.sets(st.sampled_from(METHODS), min_size=1)):
            found.append(MethodRow(exposure, 33 * exposure, method, draw(SAID)))
    return found


def other(value: Compared) -> Compared:
    """Another value of the same kind."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, tuple):
        return (value[0] + 1.0, *value[1:])
    return value + "x" if isinstance(value, str) else 1.5 if value is None else value + 1


@given(runs())
def test_a_run_is_like_itself(run: list[MethodRow]) -> None:
    assert not list(divergences(run, run, METHODS))


@given(runs(), st.data())
def test_one_planted_change_is_found_alone_with_both_values(run: list[MethodRow], data: st.DataObject) -> None:
    i, key = data.draw(st.integers(0, len(run) - 1)), data.draw(st.sampled_from(KEYS))
    row = run[i]
    changed = replace(row, values={**row.values, key: other(row.values[key])})
    (found,) = divergences(run, [*run[:i], changed, *run[i + 1 :]], METHODS)
    (difference,) = found.differences
    assert (found.exposure, found.time_ns, difference.name) == (row.exposure, row.time_ns, f"{row.method}.{key}")
    assert (difference.a, difference.b) == (row.values[key], changed.values[key])
    assert difference.by == distance(key, difference.a, difference.b)


@given(runs(), runs())
def test_the_sides_can_be_swapped(a: list[MethodRow], b: list[MethodRow]) -> None:
    one, two = (list(divergences(*sides, METHODS)) for sides in ((a, b), (b, a)))
    assert [d.exposure for d in one] == [d.exposure for d in two] == sorted({d.exposure or 0 for d in one})
    assert [d.names for d in one] == [d.names for d in two]


@given(runs(), st.data())
def test_a_step_that_one_side_lacks_is_named(run: list[MethodRow], data: st.DataObject) -> None:
    i = data.draw(st.integers(0, len(run) - 1))
    (found,) = divergences(run, run[:i] + run[i + 1 :], METHODS)
    (difference,) = found.differences
    assert (difference.name, difference.a, difference.b) == (f"{run[i].method}.step", "present", None)


def test_methods_that_are_not_compared_do_not_count() -> None:
    a, b = (MethodRow(0, 0, "stereo", {"alive": alive}) for alive in (1, 2))
    assert not list(divergences([a], [b], ("monocular",))) and list(divergences([a], [b], METHODS))


@pytest.mark.parametrize(("tolerance", "apart"), [(0.0, True), (1e-7, True), (2e-6, False)])
def test_the_tolerance_is_relative_above_one_and_absolute_below(tolerance: float, apart: bool) -> None:
    for size in (1e-9, 1.0, 1e6):
        step = 1e-6 * max(size, 1.0)
        for a, b in ((size, size + step), ((size, 0.0, 0.0), (size + step, 0.0, 0.0))):
            rows = ([MethodRow(0, 0, "stereo", {"x": value, "y_digest": str(value)})] for value in (a, b))
            assert bool(list(divergences(*rows, METHODS, tolerance))) == apart


@given(st.floats(1e-12, 3.1))
def test_orientations_differ_by_the_angle_between_them(angle_rad: float) -> None:
    a = Pose.from_rotvec(np.array([0.3, -0.2, 0.9]), np.zeros(3))
    b = a @ Pose.from_rotvec(np.array([0.0, angle_rad, 0.0]), np.zeros(3))
    x, y = tuple(a.xyzw.tolist()), tuple((-b.xyzw).tolist())
    found = distance("orientation_xyzw", x, y)
    assert found == pytest.approx(math.degrees(angle_rad), rel=1e-3, abs=1e-13)


def test_what_is_known_to_differ_can_be_left_out() -> None:
    a, b = (MethodRow(0, 0, "stereo", {"alive": n, "new": n}) for n in (1, 2))
    (found,) = divergences([a], [b], METHODS)
    news = found.without(frozenset({"stereo.alive"}))
    assert news is not None and news.names == {"stereo.new"} and found.without(found.names) is None
