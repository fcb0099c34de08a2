"""What is compared of a step, in the order in which one follows from the other."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from ispom.types import Decision, Step

from ..history.quantities import POSE, STEP_QUANTITIES, finite, step_values
from ..history.quantity import Value
from ..history.record import ExposureRecord
from ..history.step_quantities.step import DROPPED
from ..run_folder.digests import DIGESTS
from .compare import ORIENTATION, POSITION, Compared, MethodRow

FOLLOWED = "tracks_digest"
FATES = ("fates_digest", *DROPPED, "new", "alive")
"""What became of tracks, and new ones: much of it follows from checks, such as that of a key frame."""
RESULTS = tuple(q.key for q in STEP_QUANTITIES if q.key not in (*FATES, "seconds"))
"""What follows from tracks and checks; wall times never count."""
FROM_POINTS = frozenset({FOLLOWED, *FATES, "inliers", "residual_median_px", "landmarks", "landmarks_digest"})
"""What cannot be told of a record without its tracks, landmarks and residuals."""
AT_LAST = tuple(key for key in DIGESTS if key not in (FOLLOWED, *FATES))


def in_order(
    said: Mapping[str, Value], checks: Iterable[Decision], pose: tuple[float, ...] | None
) -> Mapping[str, Compared]:
    """`said` by key of STEP_QUANTITIES and DIGESTS; the pose as (x, y, z, qx, qy, qz, qw)."""
    found: dict[str, Compared] = {FOLLOWED: said[FOLLOWED]}
    for d in checks:
        name = ".".join(filter(None, (d.key, d.about)))
        found |= {name: finite(d.value), f"{name}.threshold": finite(d.threshold)}
        found |= {f"{name}.passed": bool(d.passed), f"{name}.consequence": d.consequence}
    found |= {key: said[key] for key in (*FATES, *RESULTS)}
    if pose is not None:
        found |= {POSITION: pose[:3], ORIENTATION: pose[3:]}
    return found | {key: said[key] for key in AT_LAST}


def step_row(index: int, step: Step, error_m: float | None) -> MethodRow:
    """Of a step in memory: the same as its run's folder gives."""
    said = {**step_values(step, error_m), **{key: of(step) for key, of in DIGESTS.items()}}
    return MethodRow(index, step.time_ns, step.method, in_order(said, step.decisions, stored_pose(said)))


def record_rows(record: ExposureRecord, methods: Collection[str]) -> Iterator[MethodRow]:
    """Of the exposure's steps of these methods, be they computed or read from a run's folder."""
    for step in record.steps:
        if step.method not in methods:
            continue
        if record.stored is None:
            yield step_row(record.index, step, record.errors_m.get(step.method))
        else:
            said = record.stored[step.method]
            yield MethodRow(record.index, step.time_ns, step.method, in_order(said, step.decisions, stored_pose(said)))


def stored_pose(said: Mapping[str, Value]) -> tuple[float, ...] | None:
    """(x, y, z, qx, qy, qz, qw) of what a step said; None where it has no pose."""
    numbers = tuple(value for value in map(said.get, POSE) if isinstance(value, float))
    return numbers or None
