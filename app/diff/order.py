"""What is compared of a step, in the order in which one follows from the other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ispom.types import Step

from ..run.folder.digests import DIGESTS
from ..run.history.quantities import DROPPED, STEP_QUANTITIES, finite, step_values
from .compare import ORIENTATION, Compared, MethodRow

FATES = ("tracks_digest", "alive", "new", *DROPPED)
RESULTS = tuple(q.key for q in STEP_QUANTITIES if q.key not in (*FATES, "seconds"))
"""What follows from tracks and checks; wall times never count."""
FROM_POINTS = frozenset({*FATES, "inliers", "residual_median_px", "landmarks", "landmarks_digest"})
"""What cannot be told of a record without its tracks, landmarks and residuals."""
AT_LAST = tuple(key for key in DIGESTS if key not in FATES)


@dataclass(frozen=True)
class Made:
    """A check as it was made."""

    name: str
    """Its key; KEY.ABOUT where it is about something."""
    value: float | None
    threshold: float | None
    passed: bool
    consequence: str


def in_order(
    said: Mapping[str, Compared], checks: Iterable[Made], pose: tuple[float, ...] | None
) -> Mapping[str, Compared]:
    """`said` by key of STEP_QUANTITIES and DIGESTS; the pose as (x, y, z, qx, qy, qz, qw)."""
    found = {key: said[key] for key in FATES}
    for check in checks:
        found |= {check.name: check.value, f"{check.name}.threshold": check.threshold}
        found |= {f"{check.name}.passed": check.passed, f"{check.name}.consequence": check.consequence}
    found |= {key: said[key] for key in RESULTS}
    if pose is not None:
        found |= {"position": pose[:3], ORIENTATION: pose[3:]}
    return found | {key: said[key] for key in AT_LAST}


def step_row(index: int, step: Step, error_m: float | None) -> MethodRow:
    """Of a step in memory: the same as its run's folder gives."""
    said = {**step_values(step, error_m), **{key: of(step) for key, of in DIGESTS.items()}}
    made = [
        Made(
            ".".join(filter(None, (d.key, d.about))),
            finite(d.value),
            finite(d.threshold),
            bool(d.passed),
            d.consequence,
        )
        for d in step.decisions
    ]
    pose = step.world_from_frame
    numbers = None if pose is None else (*pose.translation.tolist(), *pose.xyzw.tolist())
    return MethodRow(index, step.time_ns, step.method, in_order(said, made, numbers))
