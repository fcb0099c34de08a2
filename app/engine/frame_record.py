"""The record of a frame: the definition and the value of each number of a method at a frame.

Card, dock, header, report, published page, recording and agents read numbers here. Each key has one definition, so
the same label shows the same value everywhere. Numbers that differ on purpose have different labels. The live error
compares the pose as it was given at its frame, without an alignment. The position error compares the trajectory as
known now, after the alignment of the ATE, which is one number for the whole run.
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
    """Label that people read."""
    text: str
    unit: str = ""
    when: When = "then"
    """`then`: as the step gave it; it never changes. `now`: as known now; later frames may change it until the run
    ends."""
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
        """Returns the status of the method's latest step up to this frame; None before its first step."""
        return self.record.statuses.get(self.method)

    @cached_property
    def values(self) -> Mapping[str, Value]:
        """Returns the values of the method's step at this frame by key: STEP_QUANTITIES and checks. Empty where it did
        not step."""
        return self.record.values_by_method.get(self.method, {})

    @property
    def error_m(self) -> float | None:
        """Returns the position error (ERROR) of the method's latest pose up to this frame."""
        return None if self.curve is None else self.curve.at(self.record.time_ns)

    @property
    def aligned(self) -> str:
        """Returns the name of the alignment."""
        return "" if self.curve is None else self.curve.aligned

    def number(self, key: str) -> float | None:
        """Returns a value of the step if it is a number, else None."""
        value = self.values.get(key)
        return None if value is None or isinstance(value, str) else float(value)
