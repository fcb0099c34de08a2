"""The numbers of the graph of `fused` besides its nodes: the prior of the first ones, revised motions, biases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ispom.geometry import Array, Pose, skew
from ispom.sensors.fusion import Node
from ispom.types import ClockOffset, Corrections, Gravity, ImuBias


@dataclass(frozen=True, eq=False)
class Prior:
    """Information about the first K nodes of the window from all nodes that left it."""

    at: tuple[Node, ...]
    """Linearisation point."""
    information: Array
    """(K D, K D)"""
    vector: Array
    """(K D,) information times the most likely difference."""
    without: Mapping[str, Array]
    """(K D, K D) information without each sensor."""


def revised_nodes(nodes: tuple[Node, ...], cameras: Mapping[int, Pose]) -> tuple[Node, ...]:
    """Returns nodes with the motions of the images by revised poses of their camera, by time."""
    found = [replace(node, camera=cameras.get(node.time_ns, node.camera)) for node in nodes]
    for i, (before, now) in enumerate(pairwise(found), 1):
        both = before.time_ns in cameras and now.time_ns in cameras and now.visual is not None
        if both and before.camera is not None and now.camera is not None:
            found[i] = replace(now, visual=before.camera.inverse() @ now.camera)
    return tuple(found)


DOWN = np.array([0.0, 0.0, -1.0])
"""Direction of gravity in the local frame."""


def imu_of(node: Node, covariance: Array, unknowns: Mapping[str, Array], clock: ClockOffset | None) -> Corrections:
    """Returns biases and gravity in the rig at a node, of the covariance (6, 6) of its pose and those of its unknowns
    by their letters, besides the clock; nothing without an IMU."""
    if "b" not in unknowns:
        return Corrections()
    down = node.local_from_rig.rotation.T @ DOWN
    along = skew(down)
    gravity = Gravity(down, along @ covariance[3:, 3:] @ along.T)
    return Corrections(imu=ImuBias.of(node.bias, unknowns["b"]), gravity=gravity, imu_clock=clock)
