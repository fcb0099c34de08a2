"""The numbers of the graph of `fused` besides its nodes: the prior of the first ones, and revised motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from ispom.geometry import Array, Pose
from ispom.sensors.fusion import Node


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the first K nodes of the window by all that left it."""

    at: tuple[Node, ...]
    """Where it is linear."""
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
