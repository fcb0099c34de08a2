"""The last located pair, and the motion that is expected to go on from it."""

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
"""Out of sight the motion is held to go on for so long, or for one more interval between pairs; then to end."""
CHANGE = 0.5
"""Standard deviation of how a motion may differ from the expected one, as a share of it: the rig may stop (2 sigma)."""
REST_BASELINES, REST_RAD = 0.1, 0.05
"""The same where none is expected, from one pair to the next: in baselines, as the rig's size goes with its speed, and
[rad], 3 degrees."""
UNKNOWN_BASELINES_S, UNKNOWN_RAD_S = 40.0, 1.0
"""Standard deviation of a motion of which nothing was measured, in baselines per second (a car on a country road, a
camera in a running hand), and [rad/s]: the prediction then is the place of the first pair, which tells nothing."""

SHAKE_RAD_S = 2 * np.pi * 2.5
"""A hand, a step or a road shakes with some 1 to 4 Hz: how fast a motion changes, for how much it may differ."""


def motion_sigma(way: Pose, baseline_m: float) -> Array:
    """(6,) standard deviations of how a motion may differ from this expected one, and a little at rest."""
    moved, turned = float(np.linalg.norm(way.translation)), float(np.linalg.norm(twist_of(way)[3:]))
    return np.repeat([CHANGE * moved + REST_BASELINES * baseline_m, CHANGE * turned + REST_RAD], 3)


@dataclass(frozen=True, eq=False)
class LastPair:
    """The last located pair, and how the rig moved until then."""

    left: Image | None = None
    key_left: Image | None = None
    """Of the newest key frame."""
    key_half: Image | None = None
    """The same at half its size."""
    points: PairPoints = PairPoints()
    time_ns: int = 0
    left_from_world: Pose = field(default_factory=Pose)
    motion: Pose = field(default_factory=Pose)
    """curr_left_from_prev_left of the last two located pairs."""
    motion_s: float = 0.0
    """Time between them; 0 before two pairs were located by the same points."""
    covariance: Array | None = None
    """(6, 6) of left_from_world's left twist."""

    @cached_property
    def rate(self) -> Array:
        """(6,) of left_from_world's change (rho [m/s], phi [rad/s]), left."""
        return twist_of(self.motion) / self.motion_s if self.motion_s > 0 else np.zeros(6)

    def believed_motion(self, time_ns: int, baseline_m: float) -> MotionPrior:
        """How left_from_world moves at a time, if the motion goes on as it was; it may differ, as `motion_sigma`."""
        seconds = self.motion_s if self.motion_s > 0 else max(self._since_s(time_ns), 1e-3)
        sigma = motion_sigma(self.motion, baseline_m) / seconds
        return MotionPrior(steady(self.rate), np.concatenate([sigma, SHAKE_RAD_S * sigma]))

    def predicted(self, time_ns: int) -> Pose:
        """left_from_world if the motion goes on as it was, COASTING_S long at most."""
        return self._way(self._coasting_s(time_ns)) @ self.left_from_world

    def predicted_covariance(self, time_ns: int, baseline_m: float) -> Array:
        """(6, 6) of the left twist of `predicted`: what was known before, and how much else may have happened since.

        That is the more, the longer nothing was seen: the motion may have gone on after the prediction holds it to end,
        or no motion was measured before.
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
