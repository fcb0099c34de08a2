"""The noise of the images' motions, from the covariance that the visual method states for its poses.

This is the covariance of a pose relative to the first pose of its world. It grows by the errors of the motions since
then: those of rotations about the middle of the scene grow with time, those of translations with the distance moved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Array, Pose
from ispom.sensors.fusion import MotionNoise
from ispom.types import Step

SETTLED_S = 1.0
"""Time from which on the growth of the images' uncertainty counts: that of the first pose is zero by definition."""
LEAST_WAY = 1e-9
"""A shorter way [unit] shows no error of translations."""


@dataclass(frozen=True, eq=False)
class Growth:
    """The time and distance over which the uncertainty of the images has grown, in their present world."""

    begun_ns: int
    time_ns: int
    world_from_frame: Pose
    """Pose of the last image."""
    way: float = 0.0
    """[unit]"""

    @property
    def seconds(self) -> float:
        return (self.time_ns - self.begun_ns) * 1e-9


def grown(growth: Growth | None, visual: Step) -> Growth | None:
    """Returns the growth up to an image; the same where that states no covariance."""
    pose = visual.world_from_frame
    if pose is None or visual.covariance is None:
        return growth
    if growth is None:
        return Growth(visual.time_ns, visual.time_ns, pose)
    moved = growth.world_from_frame.inverse() @ pose
    way = growth.way + float(np.linalg.norm(moved.translation))
    return replace(growth, time_ns=visual.time_ns, world_from_frame=pose, way=way)


def stated_noise(growth: Growth | None, visual: Step, otherwise: MotionNoise) -> MotionNoise | None:
    """Returns the noise of the motions that explains the covariance which an image states; None as long as that does
    not determine it.

    Values that it does not determine are those of `otherwise`.
    """
    pose, covariance = visual.world_from_frame, visual.covariance
    if growth is None or pose is None or covariance is None or growth.seconds < SETTLED_S:
        return None
    xyz = pose.inverse().apply(visual.landmarks.xyz_in_world)
    found = replace(
        otherwise,
        turn=float(np.sqrt(np.trace(covariance[3:, 3:]) / (3 * growth.seconds))),
        depth=float(np.median(xyz[:, 2])) if len(xyz) else otherwise.depth,
    )
    if visual.scale_sigma is not None:
        found = replace(found, scale_walk=float(visual.scale_sigma / np.sqrt(growth.seconds)))
    if growth.way < LEAST_WAY:
        return found
    # A camera in a unit of its own does not state how one length differs from the next: `share` stays along the motion.
    share = 0.0 if visual.frame == "rig" else otherwise.share
    return replace(found, share=share, walk=_walk(covariance, growth.way))


def _walk(covariance: Array, way: float) -> float:
    """Returns the error of translations by the root of their length [sqrt(unit)], from the covariance (6, 6).

    In the direction in which the position is known best, rotations and the scale add the least to it. They still add
    something, so that this is the most that the translations can err by.
    """
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[0], 0.0) / way))
