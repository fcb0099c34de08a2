"""Results: what one estimator reports about one measurement, and the checks that steered it."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

import numpy as np

from ispom.geometry import Array, Pose
from ispom.types.corrections import Corrections
from ispom.types.rig import FrameName
from ispom.types.tracks import ImageLines, Landmarks, Tracks, WorldLines
from ispom.types.trajectory import SegmentFit, SplineFit, Trajectory

DecisionKind = Literal["requirement", "trigger", "finding", "warning"]


@dataclass(frozen=True)
class Decision:
    """A named check that steered the estimator: "parallax 14.2 px >= 20 px: no"."""

    name: str
    """Description of the compared quantity."""
    value: float
    threshold: float
    passed: bool
    unit: str = ""
    relation: Literal[">=", "<=", ">", "<", "="] = ">="
    consequence: str = ""
    """The consequence, if the name does not make it obvious."""
    key: str = ""
    """Stable name for plots, columns and break points, as in `parallax`; unique within a Step together with `about`."""
    question: str = ""
    """The question that the check helps to answer ("New keyframe?"); empty for an independent check."""
    kind: DecisionKind = "requirement"
    """requirement: a check that must pass; trigger: a check of which one is enough to answer the question with yes;
    finding: a measurement with a threshold, of which neither outcome is a failure; warning: a measurement that is
    doubtful if it does not pass, although the method continues."""
    about: str = ""
    """The track, pair or keyframe of the check, where a Step has the same check several times."""

    @property
    def failed(self) -> bool:
        return self.kind == "requirement" and not self.passed

    @property
    def margin(self) -> float:
        """Difference of value and threshold; positive where the check passes."""
        gap = self.value - self.threshold
        return -abs(gap) if self.relation == "=" else -gap if self.relation in ("<", "<=") else gap

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        outcome = "yes" if self.passed else "no"
        text = f"{self.name} {self.value:.4g}{unit} {self.relation} {self.threshold:.4g}{unit}: {outcome}"
        return f"{text} ({self.consequence})" if self.consequence else text


Relation = Literal[">=", "<=", ">", "<"]
Topic = Literal["", "pose", "map", "scale", "motion", "loop", "pair"]
COMPARED = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}


@dataclass(frozen=True)
class Check:
    """One kind of check, see Decision for the fields. All checks of a method are in its `checks.py`."""

    key: str
    name: str
    kind: DecisionKind
    question: str = ""
    relation: Relation = ">="
    unit: str = ""
    passes: str = ""
    """The sentence if it passes: "Keyframe: moved {value} degrees, {threshold} are enough."; with {value}, {threshold}
    and {margin} as numbers, in any format of a float, as in {value:.0%}."""
    fails: str = ""
    """The sentence if it does not pass; empty for the same sentence. The part before a colon, as in "Lost: {value}
    inliers ({threshold} needed).", is the headline of a verdict that the check decides."""
    topic: Topic = ""
    """The subject of verdicts and events: `pose` (localisation of the frame), `map` (first map), `scale`, `motion`
    (second motion), or `loop` (loop closure)."""

    def __post_init__(self) -> None:
        """Raises ValueError for a sentence with any other placeholder."""
        for text in (self.passes, self.fails):
            try:
                text.format(value=0.5, threshold=0.5, margin=0.5)
            except (LookupError, ValueError, AttributeError) as fault:
                raise ValueError(f"check {self.key!r} has a sentence that cannot be filled in: {text!r}") from fault

    def of(self, value: float, threshold: float, consequence: str = "", passed: bool | None = None) -> Decision:
        """Returns the decision for a value; `passed` replaces the outcome of the comparison."""
        value, threshold = float(value), float(threshold)
        if passed is None:
            passed = bool(COMPARED[self.relation](value, threshold))
        return Decision(
            self.name,
            value,
            threshold,
            passed,
            self.unit,
            self.relation,
            consequence,
            self.key,
            self.question,
            self.kind,
        )


def by_key(*checks: Check) -> dict[str, Check]:
    """Returns checks by their keys. Raises ValueError for two checks with the same key."""
    checks_by_key = {check.key: check for check in checks}
    if len(checks_by_key) < len(checks):
        raise ValueError(f"two checks have one key: {', '.join(sorted(check.key for check in checks))}")
    return checks_by_key


class Status(StrEnum):
    """State of a method."""

    INITIALISING = "initialising"
    TRACKING = "tracking"
    LOST = "lost"


@dataclass(frozen=True, eq=False, repr=False)
class Step:
    """All results of one estimator at one measurement."""

    time_ns: int
    status: Status
    frame: FrameName = "rig"
    """Frame of the pose: the rig, or the video camera if the scale is unknown, so that the lever arm cannot be
    applied."""
    world_from_frame: Pose | None = None
    covariance: Array | None = None
    """(6, 6) covariance of the right twist (rho, phi) of the pose; None for a method without covariances."""
    key_frame: bool = False
    tracks: Mapping[str, Tracks] = field(default_factory=dict)
    """Tracks by camera name: video, left."""
    landmarks: Landmarks = field(default_factory=Landmarks.empty)
    """New or revised points of this step (a viewer replaces them by id)."""
    residuals_px: Array = field(default_factory=lambda: np.zeros(0))
    """(K,) reprojection errors of the inliers of the pose estimate."""
    revised: Trajectory = field(default_factory=Trajectory.empty)
    """Poses of earlier frames that this step improved, or estimated for the first time."""
    scale: float | None = None
    """Scale factor of the transfer to this step (1: unchanged); None where no scale was transferred."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time per stage; the only values here that differ between runs."""
    decisions: tuple[Decision, ...] = ()
    parts: tuple[Step, ...] = ()
    """Steps at the same frame of the estimators that this one combines."""
    scale_sigma: float | None = None
    """Standard deviation of the logarithm of the current scale relative to the first one, or to the metre where a
    method with a metric unit finds its scale on the way; None where it is unknown."""
    method: str = ""
    """The method's name, which the ensemble sets."""
    final_until_ns: int | None = None
    """Time before which poses will hardly be revised any more; None where it is not known yet."""
    restarted: bool = False
    """Whether a new segment starts at this frame: no observation relates its pose or its scale to earlier ones."""
    segment_age_ns: int = 0
    """Where a segment starts: how long before this frame its first one was, whose pose is a revised one."""
    joins: int | None = None
    """Number of an earlier segment whose world and scale the current one has, since its keyframes were recognised.
    Segments are counted from 0; each restart starts the next one. None where no earlier segment was recognised."""
    provisional: bool = False
    """Whether the pose is not metric yet: the last one before the first fit of an integration, which will replace it,
    or one in a guessed unit."""
    calibration: Corrections = field(default_factory=Corrections)
    """The method's current corrections of the calibration."""
    segments: tuple[SegmentFit, ...] = ()
    """The segments that an integration fitted in this step."""
    spline: SplineFit | None = None
    """The spline that an integration optimised in this step."""
    other_motion: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera name, the current positions of tracks that do not fit the static scene, but one other rigid motion;
    empty for a camera without a second motion (check `second_motion`)."""
    lines: Mapping[str, ImageLines] = field(default_factory=dict)
    """By camera name, lines to draw on its image besides the tracks."""
    world_lines: WorldLines = field(default_factory=WorldLines.empty)
    """All current lines of the scene; they replace those of earlier steps."""

    @property
    def segment_from_ns(self) -> int:
        """Time of the first frame of the segment that starts here."""
        return self.time_ns - self.segment_age_ns

    @property
    def inliers(self) -> int:
        """Number of observations from which the pose was estimated."""
        return len(self.residuals_px)

    def __repr__(self) -> str:
        keyframe = ", keyframe" if self.key_frame else ""
        pose = "no pose" if self.world_from_frame is None else f"pose of the {self.frame}"
        name = f"{self.method} " if self.method else ""
        return f"Step({name}at {self.time_ns * 1e-9:.3f} s: {self.status}, {pose}, {self.inliers} inliers{keyframe})"
