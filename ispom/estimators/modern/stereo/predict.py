"""The last localised frame, and the motion model that predicts the next poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo.pair import PairPoints
from ispom.estimators.modern.stereo.shutter import MotionPrior
from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.types import Image

COASTING_S = 2.0
"""Time [s] for which a lost camera is predicted to keep its motion, or one interval between frames if longer; then it
is predicted to rest."""
MOTION_CHANGE = 0.5
"""Standard deviation of a motion from the predicted one, relative to it: the rig may stop (2 sigma)."""
REST_BASELINES, REST_RAD = 0.1, 0.05
"""Standard deviation of a motion from one frame to the next if none is predicted: in baselines, as larger rigs move
faster, and [rad] (3 degrees)."""
UNKNOWN_BASELINES_S, UNKNOWN_RAD_S = 40.0, 1.0
"""Standard deviation of a motion that was never measured, in baselines per second (a car on a country road, a running
person's camera), and [rad/s]: the prediction then is the pose of the first frame."""

SHAKE_RAD_S = 2 * np.pi * 2.5
"""Angular frequency of a camera's shake [rad/s], which relates the change of a motion to its deviation. Hands, steps
and roads shake with some 1 to 4 Hz."""


def motion_sigma(way: Pose, baseline_m: float) -> Array:
    """Returns the standard deviations (6,) of a motion from this predicted one; they are not zero at rest."""
    moved, turned = float(np.linalg.norm(way.translation)), float(np.linalg.norm(twist_of(way)[3:]))
    return np.repeat([MOTION_CHANGE * moved + REST_BASELINES * baseline_m, MOTION_CHANGE * turned + REST_RAD], 3)


@dataclass(frozen=True, eq=False)
class LastPair:
    """The last localised frame, and the motion of the rig up to it."""

    left: Image | None = None
    key_left: Image | None = None
    """Left image of the newest keyframe."""
    key_half: Image | None = None
    """The newest keyframe's left image at half size."""
    points: PairPoints = PairPoints()
    time_ns: int = 0
    left_from_world: Pose = field(default_factory=Pose)
    motion: Pose = field(default_factory=Pose)
    """curr_left_from_prev_left of the last two localised frames."""
    motion_s: float = 0.0
    """Time between these frames; 0 before two frames were localised by the same points."""
    covariance: Array | None = None
    """(6, 6) covariance of left_from_world, as a left twist."""

    @cached_property
    def rate(self) -> Array:
        """Returns the rate (6,) of left_from_world, a left twist (rho [m/s], phi [rad/s]) per second."""
        return twist_of(self.motion) / self.motion_s if self.motion_s > 0 else np.zeros(6)

    def motion_prior(self, time_ns: int, baseline_m: float) -> MotionPrior:
        """Returns the prior of left_from_world's motion at a time: the last motion, with `motion_sigma`."""
        seconds = self.motion_s if self.motion_s > 0 else max(self._since_s(time_ns), 1e-3)
        sigma = motion_sigma(self.motion, baseline_m) / seconds
        return MotionPrior(steady(self.rate), np.concatenate([sigma, SHAKE_RAD_S * sigma]))

    def predicted(self, time_ns: int) -> Pose:
        """Returns left_from_world if the motion continues, for COASTING_S at most."""
        return self._way(self._coasting_s(time_ns)) @ self.left_from_world

    def predicted_covariance(self, time_ns: int, baseline_m: float) -> Array:
        """Returns the covariance (6, 6) of `predicted`, as a left twist: the last one plus that of the motion since.

        It grows with time: the motion may have continued after its predicted end, or no motion was measured before.
        """
        coasting_s = self._coasting_s(time_ns)
        way, beyond = self._way(coasting_s), (self._since_s(time_ns) - coasting_s) * self.rate
        known = np.zeros((6, 6)) if self.covariance is None else way.adjoint @ self.covariance @ way.adjoint.T
        moved, turned = float(np.linalg.norm(beyond[:3])), float(np.linalg.norm(beyond[3:]))
        if self.motion_s <= 0:
            since_s = self._since_s(time_ns)
            moved, turned = UNKNOWN_BASELINES_S * baseline_m * since_s, UNKNOWN_RAD_S * since_s
        further = np.repeat([moved, min(turned, np.pi)], 3)
        return known + np.diag((motion_sigma(way, baseline_m) + further) ** 2)

    def _since_s(self, time_ns: int) -> float:
        return (time_ns - self.time_ns) * 1e-9

    def _coasting_s(self, time_ns: int) -> float:
        return min(self._since_s(time_ns), max(COASTING_S, self.motion_s))

    def _way(self, seconds: float) -> Pose:
        if self.motion_s <= 0:
            return Pose()
        return Pose.exp(self.rate * seconds)
