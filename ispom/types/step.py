"""What one estimator says about one exposure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

import numpy as np

from ispom.geometry import Array, Pose
from ispom.types.camera import Frame
from ispom.types.integration import SegmentFit, SplineFit
from ispom.types.tracks import Landmarks, Tracks
from ispom.types.trajectory import Trajectory

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
    measurement beside its threshold, where neither outcome is a failure; warning: a measurement that is doubtful
    where it does not pass, though the method goes on."""
    about: str = ""
    """The track, pair or key frame that it is about, where a Step has the same check several times."""

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


class Status(StrEnum):
    """Whether a method knows where it is."""

    INITIALISING = "initialising"
    TRACKING = "tracking"
    LOST = "lost"


@dataclass(frozen=True, eq=False)
class Step:
    """All that one estimator can say about one exposure."""

    time_ns: int
    status: Status
    frame: Frame = "rig"
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
    """Poses of earlier exposures that this step made better, or gave for the first time."""
    scale: float | None = None
    """The factor that carried the unit into this step (1 = kept); None where no scale was transferred."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time per stage; the only values here that differ between runs."""
    decisions: tuple[Decision, ...] = ()
    parts: tuple[Step, ...] = ()
    """Steps of the estimators that this one is made of, at the same exposure."""
    scale_sigma: float | None = None
    """Standard deviation of the logarithm of the unit here, relative to that at the start; None where unknown."""
    method: str = ""
    """The method's name; put in by the ensemble."""
    final_until_ns: int | None = None
    """Poses before this time will hardly be revised any more; None where that is not known yet."""
    restarted: bool = False
    """A new segment begins at this frame: no observation tells where it is, or its unit, against earlier ones."""
    joins: int | None = None
    """The number of an earlier segment whose world and unit the present one has, as its keyframes were found again; the
    first is 0, and each restart begins the next. None where nothing was found out."""
    provisional: bool = False
    """The pose comes from before the first fit of an integration: it only says where the rig was last known to be, and
    the fit replaces it."""
    calibration: Mapping[str, Array] = field(default_factory=dict)
    """What was found to be wrong with the calibration so far, by name: `pair` (E,) as
    solvers.right_camera.TERMS, `pair_rate` (6,) the motion that its late right shutter sees
    (left_from_world's change: rho [m/s], phi [rad/s]; left), `lens` (2,) as the `extra` of a
    solvers.window.adjustment.Window of one camera, `rig` (7,) how the video camera is turned about its own axes [rad],
    moved along the rig's [m], and how late its clock is [s]. Each but the motion with NAME_covariance where that is
    known; 0 in it for what is held. Beside these `noise` (2,): how far off a track is, and what covariances take it
    for; on the plane z = 1."""
    segments: tuple[SegmentFit, ...] = ()
    """The segments that an integration fitted in this step, and how."""
    spline: SplineFit | None = None
    """The spline that an integration adjusted in this step."""
    other_motion: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera name, tracks that ended as no images of still points, and that one other rigid motion explains, where
    they are in this exposure; none of a camera where it is not told of one (check `second_motion`)."""
