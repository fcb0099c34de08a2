"""The numbers of the graph of `fused`: nodes, the prior of the first one, and the noise of the images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.survey.fused_links import FLOOR_M, FLOOR_RAD, Fix, Inertial, Link
from ispom.geometry import Array, Pose
from ispom.types import LensCorrection


@dataclass(frozen=True, eq=False)
class Points:
    """Tracked points of one image."""

    ids: NDArray[np.int64]
    """(N,) of their tracks."""
    xy: NDArray[np.float32]
    """(N, 2) normalised coordinates, without distortion."""

    def __len__(self) -> int:
        return len(self.ids)

    def corrected(self, lens: LensCorrection) -> Points:
        """Returns the points where a right lens would show them."""
        squared = (self.xy**2).sum(axis=1, keepdims=True)
        return Points(self.ids, (self.xy / (1 + lens.focal + lens.radial * squared)).astype(np.float32))

    def without(self, ids: NDArray[np.int64]) -> Points:
        """Returns the points of other tracks."""
        kept = ~np.isin(self.ids, ids)
        return Points(self.ids[kept], self.xy[kept])


NO_POINTS = Points(np.zeros(0, np.int64), np.zeros((0, 2), np.float32))


@dataclass(frozen=True, eq=False)
class Node:
    """A time of the window, its estimate, and what was measured since the node before."""

    number: int
    time_ns: int
    local_from_rig: Pose = Pose()
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) of the body in the local frame [m/s]."""
    bias: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) accelerometer, gyroscope."""
    log_scale: float = 0.0
    """Logarithm of the metres per unit of the images."""
    camera: Pose | None = None
    """world_from_camera of the images, in their unit."""
    visual: Pose | None = None
    """camera_before_from_camera_now, in the unit of the images."""
    fresh: bool = False
    """The unit of the images is not that of the node before."""
    inertial: Inertial | None = None
    wheel: Link | None = None
    way_m: float = 0.0
    """Measured by the wheels."""
    slipped: bool = False
    laser: Link | None = None
    fixes: tuple[Fix, ...] = ()
    points: Points = NO_POINTS
    """Of the images, where they enter by their points (tight coupling)."""

    @property
    def blind(self) -> bool:
        """Whether no sensor measured the motion since the node before."""
        return all(each is None for each in (self.visual, self.inertial, self.wheel, self.laser))


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the first node of the window by all that left it."""

    at: Node
    """Where it is linear."""
    information: Array
    """(D, D)"""
    vector: Array
    """(D,) information times the most likely difference."""
    without: Mapping[str, Array]
    """(D, D) information without each sensor."""


@dataclass(frozen=True)
class Noise:
    """Of the motions that the images give."""

    turn: float
    """Standard deviation of a rotation, by the root of the time [rad/sqrt(s)]."""
    share: float
    """Of a translation, by its length."""
    scale_walk: float
    """Of the log scale, by the root of the time [1/sqrt(s)]."""

    def covariance(self, length_m: float, seconds: float) -> Array:
        """Returns (6, 6) of the twist (rho [m], phi) of a motion."""
        place, turn = self.share * length_m + FLOOR_M, self.turn * np.sqrt(seconds) + 0.1 * FLOOR_RAD
        return np.diag([place] * 3 + [turn] * 3) ** 2


def revised_nodes(nodes: tuple[Node, ...], cameras: Mapping[int, Pose]) -> tuple[Node, ...]:
    """Returns nodes with the motions of the images by revised poses of their camera, by time."""
    found = [replace(node, camera=cameras.get(node.time_ns, node.camera)) for node in nodes]
    for i, (before, now) in enumerate(pairwise(found), 1):
        both = before.time_ns in cameras and now.time_ns in cameras and now.visual is not None
        if both and before.camera is not None and now.camera is not None:
            found[i] = replace(now, visual=before.camera.inverse() @ now.camera)
    return tuple(found)
