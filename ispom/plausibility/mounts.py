"""Whether sensors can sit on the rig where its description says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ispom.geometry import Array, Pose
from ispom.plausibility.doubt import Doubt
from ispom.types import CameraSensor, FrameName, Rig

FARTHEST_M = 40.0
"""The longest aircraft are 80 m long: nothing sits farther from the middle of it."""
IN_MILLIMETRES_M = 40_000.0
"""What is farther is in millimetres up to this."""
UPSIDE_DOWN = 0.9
"""First number of a quaternion that is likely its w."""
UP, DOWN = 0.7, -0.7
"""Cosines within 45 degrees of up and of down."""
UP_IN_CAMERA = np.array([0.0, -1.0, 0.0])


def far_doubts(where: str, name: FrameName, pose: Pose) -> tuple[Doubt, ...]:
    """Returns a doubt about the place of a sensor: rig_from_NAME."""
    far = float(np.linalg.norm(pose.translation))
    if far <= FARTHEST_M:
        return ()
    likely = f"this looks like millimetres ({far * 1e-3:.3g} m); give" if far <= IN_MILLIMETRES_M else "correct it, in"
    text = f"{where}: rig_from_{name} is {far:.4g} m long, longer than any vehicle's half: {likely} metres."
    return (Doubt("mount_far", text),)


def order_doubts(where: str, name: FrameName, pose: Pose) -> tuple[Doubt, ...]:
    """Returns a doubt about a camera that looks backwards, upside down: 1 0 0 0 is no rotation where w comes first."""
    x, y, z, w = pose.xyzw.tolist()
    if abs(x) < UPSIDE_DOWN or max(map(abs, (y, z, w))) > 1 - UPSIDE_DOWN:
        return ()
    key = f"{name}.rig_from_{name}.rotation_xyzw"
    text = f"{where}: {key} turns the camera by 180 degrees about x: is its first number w? Then call it rotation_wxyz"
    return (Doubt("mount_quaternion", text),)


def gravity_doubts(where: str, rig: Rig, up: Mapping[FrameName, Array]) -> tuple[Doubt, ...]:
    """Returns doubts about sensors whose upward direction (3,), in their frame, is downward for the rig's camera, and
    upward with the quaternion's numbers in another order."""
    camera = next((n for n in ("left", "video", *rig.cameras) if isinstance(rig.sensors.get(n), CameraSensor)), None)
    if camera is None:
        return ()
    camera_from_rig = rig.rig_from(camera).inverse().rotation
    out = []
    for name, direction in up.items():
        pose = rig.rig_from(name)
        other = other_order(pose)
        now, then = (float(UP_IN_CAMERA @ camera_from_rig @ r @ direction) for r in (pose.rotation, other.rotation))
        if now < DOWN and then > UP:
            text = (
                f"{where}: rig_from_{name} has gravity upward in the {camera} camera's images, and downward where its "
            )
            text += (
                "quaternion is in the order w, x, y, z: this looks like that order, unless the camera is upside down"
            )
            out.append(Doubt("mount_quaternion", f"{text}; call it rotation_wxyz, if so."))
    return tuple(out)


def other_order(pose: Pose) -> Pose:
    """Returns the pose whose quaternion's numbers, written x, y, z, w, are w, x, y, z."""
    w, x, y, z = pose.xyzw.tolist()
    return Pose.from_xyzw(np.array([x, y, z, w]), pose.translation)
