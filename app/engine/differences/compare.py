"""Compares two sequences of rows, of runs or branches: where they first differ, in what, and by how much."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter

import numpy as np

from ispom.types import Decision, Step

from ..history.quantities import POSE, STEP_QUANTITIES, finite, step_values
from ..history.quantity import Value
from ..history.record import ExposureRecord
from ..history.step_quantities.step import DROPPED
from ..run_folder.digests import DIGESTS

Compared = Value | tuple[float, ...]
"""A position (3,) or a quaternion (4,) x, y, z, w is compared as a whole."""
POSITION, ORIENTATION = "position", "orientation_xyzw"
DIGEST = "_digest"
"""How the names of digests end. Digests are equal or not; they have no distance."""
STEP = "step"
"""The name of a step that only one side has."""


@dataclass(frozen=True)
class MethodRow:
    """The values of one method at one frame."""

    exposure: int
    time_ns: int
    method: str
    values: Mapping[str, Compared]
    """Values in the order in which a method computes them: tracks, checks, pose, landmarks. Wall times are excluded."""


Rows = Mapping[str, MethodRow]
"""The rows of one frame, by method."""


@dataclass(frozen=True)
class Difference:
    """One quantity that is not the same."""

    name: str
    """METHOD.KEY."""
    a: Compared
    b: Compared
    by: float | None
    """The difference: numbers and positions in their unit, orientations [deg]; None where it is not defined."""


@dataclass(frozen=True)
class Divergence:
    """A frame at which the sides differ."""

    exposure: int | None
    """None: the sides differ in the results of the whole run."""
    time_ns: int
    differences: tuple[Difference, ...]
    """In the order of the methods, then as MethodRow.values; never empty."""

    @property
    def names(self) -> frozenset[str]:
        """What differs."""
        return frozenset(difference.name for difference in self.differences)

    def without(self, names: frozenset[str]) -> Divergence | None:
        """Returns the divergence without the differences of these names; None where no difference is left."""
        left = tuple(difference for difference in self.differences if difference.name not in names)
        return replace(self, differences=left) if left else None


def divergences(
    a: Iterable[MethodRow], b: Iterable[MethodRow], methods: tuple[str, ...], tolerance: float = 0.0
) -> Iterator[Divergence]:
    """Every frame at which one of these methods differs by more than the tolerance; reads both sides once, side by
    side.

    Rows come in the order of frames. The tolerance of numbers is relative above 1, absolute below. With one, digests
    are not compared: they cannot tell by how much.
    """
    for left, right in _side_by_side(_by_exposure(a), _by_exposure(b)):
        pairs = [(left.get(method), right.get(method)) for method in methods]
        found = [difference for pair in pairs for difference in _differences(*pair, tolerance)]
        if found:
            row = next(row for pair in pairs for row in pair if row is not None)
            yield Divergence(row.exposure, row.time_ns, tuple(found))


def distance(name: str, a: Compared, b: Compared) -> float | None:
    """The difference of two values; None where one is missing, or they are no numbers."""
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        if name.endswith(ORIENTATION):
            return _angle_deg(np.array(a), np.array(b))
        return math.dist(a, b)
    if isinstance(a, bool) or isinstance(b, bool) or not (isinstance(a, int | float) and isinstance(b, int | float)):
        return None
    return abs(a - b)


def further(difference: Difference, tolerance: float) -> bool:
    """Whether two unequal values differ by more than the tolerance."""
    by, size = difference.by, max(1.0, _size(difference.a), _size(difference.b))
    return by is None or by > tolerance * size


def _by_exposure(rows: Iterable[MethodRow]) -> Iterator[tuple[int, Rows]]:
    for exposure, group in groupby(rows, attrgetter("exposure")):
        yield exposure, {row.method: row for row in group}


def _side_by_side(a: Iterator[tuple[int, Rows]], b: Iterator[tuple[int, Rows]]) -> Iterator[tuple[Rows, Rows]]:
    """The rows of both sides at each frame; nothing where a side lacks one."""
    x, y = next(a, None), next(b, None)
    while x is not None or y is not None:
        first = min(said[0] for said in (x, y) if said is not None)
        left, right = ({} if said is None or said[0] > first else said[1] for said in (x, y))
        yield left, right
        x, y = (next(a, None) if left else x), (next(b, None) if right else y)


def _differences(left: MethodRow | None, right: MethodRow | None, tolerance: float) -> Iterator[Difference]:
    if left is None or right is None:
        if row := left or right:
            sides = ("present" if left else None), ("present" if right else None)
            yield Difference(f"{row.method}.{STEP}", *sides, None)
        return
    if left.time_ns != right.time_ns:
        times = left.time_ns / 1e9, right.time_ns / 1e9
        yield Difference(f"{left.method}.time_s", *times, abs(left.time_ns - right.time_ns) / 1e9)
    for key in dict.fromkeys((*left.values, *right.values)):
        x, y = left.values.get(key), right.values.get(key)
        if x == y or (tolerance > 0 and key.endswith(DIGEST)):
            continue
        difference = Difference(f"{left.method}.{key}", x, y, distance(key, x, y))
        if further(difference, tolerance):
            yield difference


def _size(value: Compared) -> float:
    if isinstance(value, tuple):
        return math.hypot(*value)
    return abs(value) if isinstance(value, int | float) else 0.0


def _angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Between two unit quaternions: exact also where it is small."""
    half_chord = min(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b))) / 2
    return math.degrees(4 * math.asin(min(half_chord, 1.0)))


FOLLOWED = "tracks_digest"
FATES = ("fates_digest", *DROPPED, "new", "alive")
"""What became of tracks, and new ones: much of it follows from checks, such as that of a keyframe."""
RESULTS = tuple(q.key for q in STEP_QUANTITIES if q.key not in (*FATES, "seconds"))
"""What follows from tracks and checks; wall times never count."""
FROM_POINTS = frozenset({FOLLOWED, *FATES, "inliers", "residual_median_px", "landmarks", "landmarks_digest"})
"""Quantities that a record without its tracks, landmarks and residuals lacks."""
AT_LAST = tuple(key for key in DIGESTS if key not in (FOLLOWED, *FATES))


def in_order(
    values: Mapping[str, Value], checks: Iterable[Decision], pose: tuple[float, ...] | None
) -> Mapping[str, Compared]:
    """`values` by key of STEP_QUANTITIES and DIGESTS; the pose as (x, y, z, qx, qy, qz, qw)."""
    found: dict[str, Compared] = {FOLLOWED: values[FOLLOWED]}
    for d in checks:
        name = ".".join(filter(None, (d.key, d.about)))
        found |= {name: finite(d.value), f"{name}.threshold": finite(d.threshold)}
        found |= {f"{name}.passed": bool(d.passed), f"{name}.consequence": d.consequence}
    found |= {key: values[key] for key in (*FATES, *RESULTS)}
    if pose is not None:
        found |= {POSITION: pose[:3], ORIENTATION: pose[3:]}
    return found | {key: values[key] for key in AT_LAST}


def step_row(index: int, step: Step, error_m: float | None) -> MethodRow:
    """Returns the row of a step in memory, equal to the one that is read from its run's folder."""
    values = {**step_values(step, error_m), **{key: of(step) for key, of in DIGESTS.items()}}
    return MethodRow(index, step.time_ns, step.method, in_order(values, step.decisions, stored_pose(values)))


def record_rows(record: ExposureRecord, methods: Collection[str]) -> Iterator[MethodRow]:
    """Yields the rows of these methods at a frame, whether it was computed or read from a run's folder."""
    for step in record.steps:
        if step.method not in methods:
            continue
        if record.stored is None:
            yield step_row(record.index, step, record.errors_m.get(step.method))
        else:
            values = record.stored[step.method]
            yield MethodRow(
                record.index, step.time_ns, step.method, in_order(values, step.decisions, stored_pose(values))
            )


def stored_pose(values: Mapping[str, Value]) -> tuple[float, ...] | None:
    """(x, y, z, qx, qy, qz, qw) of a step's values; None where it has no pose."""
    numbers = tuple(value for value in map(values.get, POSE) if isinstance(value, float))
    return numbers or None
