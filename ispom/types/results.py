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
    """What is compared, in words."""
    value: float
    threshold: float
    passed: bool
    unit: str = ""
    relation: Literal[">=", "<=", ">", "<", "="] = ">="
    consequence: str = ""
    """What followed, where that is not plain from the name."""
    key: str = ""
    """Stable name for plots, columns and break points, as in `parallax`; unique within a Step together with `about`."""
    question: str = ""
    """What the check helps to answer ("New keyframe?"); empty where it stands for itself."""
    kind: DecisionKind = "requirement"
    """requirement: not passed is a failure; trigger: any one that passes answers the question with yes; finding: a
    measurement with its threshold, where neither outcome is a failure; warning: a measurement that is doubtful
    where it does not pass, though the method goes on."""
    about: str = ""
    """The track, pair or keyframe that it is about, where a Step has the same check several times."""

    @property
    def failed(self) -> bool:
        return self.kind == "requirement" and not self.passed

    @property
    def margin(self) -> float:
        """By how much the value lies on the passing side of the threshold; negative on the other side."""
        gap = self.value - self.threshold
        return -abs(gap) if self.relation == "=" else -gap if self.relation in ("<", "<=") else gap

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        outcome = "yes" if self.passed else "no"
        text = f"{self.name} {self.value:.4g}{unit} {self.relation} {self.threshold:.4g}{unit}: {outcome}"
        return f"{text} ({self.consequence})" if self.consequence else text


Relation = Literal[">=", "<=", ">", "<"]
Topic = Literal["", "pose", "map", "scale", "motion", "loop"]
COMPARED = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}


@dataclass(frozen=True)
class Check:
    """One kind of check; see Decision for what the fields mean. All of a method stand in its `checks.py`."""

    key: str
    name: str
    kind: DecisionKind
    question: str = ""
    relation: Relation = ">="
    unit: str = ""
    passes: str = ""
    """The sentence for people where it passes: "Keyframe: moved {value} degrees, {threshold} are enough."; with
    {value}, {threshold} and {margin}, as numbers, and any format that a float has, as in {value:.0%}."""
    fails: str = ""
    """The same where it does not pass; empty: the same sentence. What comes before a colon, as in "Lost: {value}
    inliers ({threshold} needed).", is the headline of a verdict that the check decides."""
    topic: Topic = ""
    """What the outcome is about, for verdicts and events: `pose` finds the pose of the frame, `map` makes the first
    map, `scale` watches the scale, `motion` looks for a second motion, `loop` closes a loop."""

    def __post_init__(self) -> None:
        """ValueError where a sentence asks for anything else."""
        for text in (self.passes, self.fails):
            try:
                text.format(value=0.5, threshold=0.5, margin=0.5)
            except (LookupError, ValueError, AttributeError) as fault:
                raise ValueError(f"check {self.key!r} has a sentence that cannot be filled in: {text!r}") from fault

    def of(self, value: float, threshold: float, consequence: str = "", passed: bool | None = None) -> Decision:
        """As made now; `passed` where more than the comparison decides."""
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
    """ValueError where two have the same key."""
    checks_by_key = {check.key: check for check in checks}
    if len(checks_by_key) < len(checks):
        raise ValueError(f"two checks have one key: {', '.join(sorted(check.key for check in checks))}")
    return checks_by_key


class Status(StrEnum):
    """Whether a method knows where it is."""

    INITIALISING = "initialising"
    TRACKING = "tracking"
    LOST = "lost"


@dataclass(frozen=True, eq=False, repr=False)
class Step:
    """All results of one estimator at one measurement."""

    time_ns: int
    status: Status
    frame: FrameName = "rig"
    """Whose pose: the rig, or the video camera where the unit is unknown (the lever arm cannot be applied)."""
    world_from_frame: Pose | None = None
    covariance: Array | None = None
    """(6, 6) of the twist (rho, phi) on the right of the pose; None where the method has none."""
    key_frame: bool = False
    tracks: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera name: video, left."""
    landmarks: Landmarks = field(default_factory=Landmarks.empty)
    """The points found or revised in this step (a viewer replaces by id)."""
    residuals_px: Array = field(default_factory=lambda: np.zeros(0))
    """(K,) reprojection errors of the inliers of the pose estimate."""
    revised: Trajectory = field(default_factory=Trajectory.empty)
    """Poses of earlier frames that this step improved, or gave for the first time."""
    scale: float | None = None
    """The factor that carried the unit into this step (1 = kept); None where no scale was transferred."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time per stage; the only values here that differ between runs."""
    decisions: tuple[Decision, ...] = ()
    parts: tuple[Step, ...] = ()
    """Steps of the estimators that this one is made of, at the same frame."""
    scale_sigma: float | None = None
    """Standard deviation of the logarithm of the unit here, relative to that at the start; None where unknown."""
    method: str = ""
    """The method's name; put in by the ensemble."""
    final_until_ns: int | None = None
    """Poses before this time will hardly be revised any more; None where that is not known yet."""
    restarted: bool = False
    """A new segment begins at this frame: no observation gives its pose, or its scale, relative to earlier ones."""
    joins: int | None = None
    """The number of an earlier segment whose world and unit the present one has, as its keyframes were found again; the
    first is 0, and each restart begins the next. None where nothing was found out."""
    provisional: bool = False
    """The pose comes from before the first fit of an integration: it only says where the rig was last known to be, and
    the fit replaces it."""
    calibration: Corrections = field(default_factory=Corrections)
    """What the method found to be wrong with the calibration so far."""
    segments: tuple[SegmentFit, ...] = ()
    """The segments that an integration fitted in this step, and how."""
    spline: SplineFit | None = None
    """The spline that an integration adjusted in this step."""
    other_motion: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera name, tracks that ended as no images of still points, and that one other rigid motion explains, where
    they are in this frame; none of a camera without a second motion (check `second_motion`)."""
    lines: Mapping[str, ImageLines] = field(default_factory=dict)
    """By camera name, what is drawn on its image besides the tracks."""
    world_lines: WorldLines = field(default_factory=WorldLines.empty)
    """All lines of the scene that are known now; they replace those of earlier steps."""

    @property
    def inliers(self) -> int:
        """Observations that the pose is from."""
        return len(self.residuals_px)

    def __repr__(self) -> str:
        keyframe = ", keyframe" if self.key_frame else ""
        pose = "no pose" if self.world_from_frame is None else f"pose of the {self.frame}"
        name = f"{self.method} " if self.method else ""
        return f"Step({name}at {self.time_ns * 1e-9:.3f} s: {self.status}, {pose}, {self.inliers} inliers{keyframe})"
