"""Combines the integration's estimates of the rig in several parts of a recording, and judges the result.

Each part's own covariance knows the noise of single points only. Errors that many points share (drift of tracks with
the image, lens errors) show in the differences of the parts: the covariance is inflated by them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.calibration.diagnostics import Parameter
from ispom.calibration.motion.hand_eye import SIZE, HandEye
from ispom.calibration.result import Clock, Verdict
from ispom.geometry import Array, Pose
from ispom.solvers.spline.problem import RigModel


@dataclass(frozen=True, eq=False)
class Part:
    """The result of one part, relative to its initial values."""

    change: Array
    """(7,) left twist of video_from_left [m, rad], and offset [s]."""
    information: Array
    """(7, 7) of it, that of the prior included."""
    prior: Array
    """(7, 7) information about no change."""

    @staticmethod
    def of(rig: RigModel, information: Array, prior: RigModel) -> Part:
        """Takes the rig as estimated, with its information (of rotation, position, offset), and as it was before."""
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
    """Number of parts of the recording; 0 where only the trajectories were used."""
    widened: float
    """Factor of the standard errors, as the parts differ."""


def combined(rough: HandEye, parts: list[Part]) -> Combined:
    """Corrects the hand-eye's values by the parts; unchanged where fewer than two parts have information."""
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


ROTATION_DEG, PLACE_M, CLOCK_S = 0.5, 0.05, 0.005
"""A standard error beyond is no value: the parameter is not determined."""
GOOD_ROTATION_DEG, GOOD_PLACE_M, GOOD_CLOCK_S = 0.1, 0.01, 0.001
ONE_AXIS = 0.1
"""The rig rotated about one axis only where the rotations about the others are less than this share of those about
it,"""
FEW_DEG = 0.5
"""and hardly at all where they are smaller from one stereo pose to the next, root mean square."""
FAR = 4.0
"""Refined values that differ from the trajectories' by this many standard errors are doubtful."""


def parameters_of(found: Combined) -> tuple[Parameter, ...]:
    """x, y, z [m] and roll, pitch, yaw [rad] of video_from_left, with the errors of its left twist."""
    pose, errors = found.video_from_left, np.sqrt(np.diag(found.covariance))
    values = np.concatenate([pose.translation, pose.rotvec])
    limits = [PLACE_M] * 3 + [float(np.radians(ROTATION_DEG))] * 3
    labels = ("x", "y", "z", "roll", "pitch", "yaw")
    return tuple(
        Parameter("video", label, float(value), float(error), bool(error <= limit))
        for label, value, error, limit in zip(labels, values, errors, limits, strict=False)
    )


def clock_of(found: Combined) -> Clock:
    """Returns the video's clock."""
    error = float(np.sqrt(found.covariance[6, 6]))
    return Clock(found.offset_s, error, error <= CLOCK_S)


def verdict_of(rough: HandEye, found: Combined) -> Verdict:
    """Returns the verdict: redo where the video camera's rotation or position is not determined."""
    listed, clock = parameters_of(found), clock_of(found)
    lost = [each.name for each in listed if not each.determined]
    redo, minor = [], []
    if lost:
        redo.append(f"video: the motion does not determine {', '.join(lost)}: {_why(rough, found)}")
    place, turn = (float(np.sqrt(np.trace(found.covariance[part, part]))) for part in (slice(0, 3), slice(3, 6)))
    if not lost and place > GOOD_PLACE_M:
        minor.append(f"video: its place is uncertain by {1000 * place:.0f} mm")
    if not lost and np.degrees(turn) > GOOD_ROTATION_DEG:
        minor.append(f"video: its rotation is uncertain by {np.degrees(turn):.2f} degrees")
    if not clock.determined:
        minor.append("video: the clock offset is not determined by this motion")
    elif clock.standard_error_s > GOOD_CLOCK_S:
        minor.append(f"video: the clock offset is uncertain by {1000 * clock.standard_error_s:.1f} ms")
    if found.parts and _apart(rough, found) > FAR:
        minor.append("video: trajectories and images disagree about its place by more than their errors")
    if not found.parts:
        minor.append("video: the recording is too short to refine its place by the images")
    advice = ("turn the rig about two axes or more, by 10 degrees and more within a second, near textured things",)
    if redo:
        return Verdict("redo", tuple(redo), advice)
    return Verdict("usable" if minor else "good", tuple(minor), advice if minor else ())


def _why(rough: HandEye, found: Combined) -> str:
    turned = np.degrees(rough.turned_rad)
    if turned[2] < FEW_DEG:
        return f"the rig turned by {turned[2]:.2f} degrees only from one stereo pose to the next, turn it more"
    if turned[1] < max(ONE_AXIS * turned[2], 1e-3):
        axis = _direction(rough.axes[2])
        return f"the rig turned about one axis only, {axis} in the left camera, turn it about another one, too"
    values, vectors = np.linalg.eigh(found.covariance[:3, :3])
    worst = 1000 * float(np.sqrt(values[-1]))
    return f"its place is open by {worst:.0f} mm along {_direction(vectors[:, -1])} of its own axes, turn the rig more"


def _apart(rough: HandEye, found: Combined) -> float:
    """Largest difference in standard errors of the trajectories' values."""
    twist = (found.video_from_left @ rough.video_from_left.inverse()).log()
    return float(np.max(np.abs(twist) / np.sqrt(np.diag(rough.covariance)[:6])))


def _direction(vector: Array) -> str:
    x, y, z = vector * np.sign(vector[np.argmax(np.abs(vector))])
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
