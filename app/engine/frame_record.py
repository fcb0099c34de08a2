"""The record of a frame: what each number of a method at a frame is, and its value.

Card, dock, header, report, published page, recording and agents read it here. One key, one definition: where two
surfaces show the same label, they show the same value. What differs on purpose has another label: the live error is of
the pose as it was given then and not aligned, the position error is of the trajectory as known now after the alignment
of the ATE, which is one number for the whole run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .error_curve import ErrorCurve
    from .history.quantity import Value
    from .history.record import ExposureRecord, MethodStatus

When = Literal["then", "now"]


@dataclass(frozen=True)
class Definition:
    """One sentence about a number, its unit, and when and how it is taken."""

    key: str
    label: str
    """As people read it."""
    text: str
    unit: str = ""
    when: When = "then"
    """`then`: as the step gave it, for good. `now`: as known now; later frames may change it, until the run ends."""
    alignment: str = ""
    """How its positions are compared with the ground truth; empty where there is none in it."""


INLIERS = Definition("inliers", "Inliers", "tracks that the pose of the step used")
RESIDUAL = Definition(
    "residual_median_px", "Residual median", "median reprojection error of the tracks that the pose used", "px"
)
LIVE_ERROR = Definition(
    "error_m",
    "Live error",
    "distance of the pose, as the step gave it, to the true position; without alignment; none while provisional",
    "m",
    alignment="none",
)
ERROR = Definition(
    "error",
    "Position error",
    "distance of the pose at this frame from the truth, after the alignment of the ATE over all poses",
    "m",
    "now",
    "that of the ATE: SE(3) of a method with a metric unit, Sim(3) of others; forks of one run are aligned together",
)
ATE = Definition(
    "ate_m",
    "ATE",
    "root mean square of the position errors of a run's own trajectory: one number for all frames",
    "m",
    "now",
    "SE(3) of a method with a metric unit, Sim(3) of others",
)
VERDICT = Definition("verdict", "Verdict", "how a method is doing, in two or three words, by its status and its checks")
LOCATED = Definition("located", "Localised", "share of a method's own frames at which it tracked")
DEFINITIONS = {d.key: d for d in (INLIERS, RESIDUAL, LIVE_ERROR, ERROR, ATE, VERDICT, LOCATED)}
"""By key."""


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """What is known of one method at one frame."""

    method: str
    record: ExposureRecord
    curve: ErrorCurve | None = None
    """Its position errors; None without ground truth."""

    @property
    def status(self) -> MethodStatus | None:
        """Of its latest step up to there; None before its first."""
        return self.record.statuses.get(self.method)

    @cached_property
    def values(self) -> Mapping[str, Value]:
        """By key, what its step at this frame says: STEP_QUANTITIES and its checks; empty where it did not step."""
        return self.record.values_by_method.get(self.method, {})

    @property
    def error_m(self) -> float | None:
        """ERROR, of its latest pose up to there."""
        return None if self.curve is None else self.curve.at(self.record.time_ns)

    @property
    def aligned(self) -> str:
        """How, for people."""
        return "" if self.curve is None else self.curve.aligned

    def number(self, key: str) -> float | None:
        """A value of its step that is a number; None where there is none."""
        value = self.values.get(key)
        return None if value is None or isinstance(value, str) else float(value)
