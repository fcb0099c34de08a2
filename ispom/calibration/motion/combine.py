"""What the integration says about the rig in several parts of a recording, as one value with an honest spread.

Each part's own covariance knows the noise of single points only. Errors that many points share (how tracks drift with
the picture, what lenses leave) show in how far parts differ: by that the covariance is widened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.calibration.motion.hand_eye import SIZE, HandEye
from ispom.geometry import Array, Pose
from ispom.solvers.spline.problem import RigModel


@dataclass(frozen=True, eq=False)
class Part:
    """Of one part, about the values that it began with."""

    change: Array
    """(7,) left twist of video_from_left [m, rad], and offset [s]."""
    information: Array
    """(7, 7) of it, that of the prior included."""
    prior: Array
    """(7, 7) information about no change."""

    @staticmethod
    def of(rig: RigModel, information: Array, prior: RigModel) -> Part:
        """Of the rig as estimated, with its information (of rotation, position, offset), and as it was before."""
        # A step (phi, tau) of rig_from_video is a left twist -(R^T tau, phi) of its inverse.
        steps = np.zeros((SIZE, SIZE))
        steps[:3, 3:6], steps[3:6, :3], steps[6, 6] = -rig.rig_from_video.rotation.T, -np.eye(3), 1.0
        back = np.linalg.inv(steps)
        turned = [back.T @ each @ back for each in (information, prior.information)]
        return Part(steps @ rig.minus(prior), turned[0], turned[1])


@dataclass(frozen=True, eq=False)
class Combined:
    """The video camera on the rig."""

    video_from_left: Pose
    offset_s: float
    covariance: Array
    """(7, 7) of the left twist of video_from_left [m, rad] and the offset [s]."""
    parts: int
    """Of the recording, that were refined apart; 0 where the trajectories alone count."""
    widened: float
    """By how much standard errors were widened, as the parts differ."""


def combined(rough: HandEye, parts: list[Part]) -> Combined:
    """The hand-eye's values, corrected by what the parts say; as they are where fewer than two parts say anything."""
    if len(parts) < 2:
        return Combined(rough.video_from_left, rough.offset_s, rough.covariance, 0, 1.0)
    prior = parts[0].prior
    total = prior + sum((part.information - prior for part in parts), np.zeros((SIZE, SIZE)))
    change = np.linalg.solve(total, sum((part.information @ part.change for part in parts), np.zeros(SIZE)))
    apart = [part.change - change for part in parts]
    chi2 = sum(float(away @ (part.information - prior) @ away) for away, part in zip(apart, parts, strict=True))
    widened = max(1.0, float(np.sqrt(chi2 / (SIZE * (len(parts) - 1)))))
    covariance = widened**2 * np.linalg.inv(total)
    pose = Pose.exp(change[:6]) @ rough.video_from_left
    return Combined(pose, rough.offset_s + float(change[6]), covariance, len(parts), widened)
