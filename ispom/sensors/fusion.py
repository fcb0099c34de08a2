"""The graph of `fused` as a kind of sensor sees it: nodes, their unknowns, observations and factors.

Poses are those of the body: of the IMU where one takes part, so that its lever arm is exact, else of the rig. The local
frame is east, north, up, or of any heading without GNSS. gtsam is imported where a factor is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, skew
from ispom.types import Decision, Kind, LensCorrection, Rig, Sensor

if TYPE_CHECKING:
    import gtsam

ORDER = np.array([3, 4, 5, 0, 1, 2])
"""Twists of gtsam are (phi, rho), those here (rho, phi)."""
FLOOR_M, FLOOR_RAD = 2e-3, 1e-3
"""Smallest standard deviations of a relative pose [m], [rad]: of a standing platform."""
LEAST_M, LEAST_RAD = 1e-4, 1e-5
"""Smallest standard deviations of a relative pose by images [m], [rad]: they only keep equations solvable."""
LOSS_WIDTH = 2.0
"""Of the robust losses [standard deviations]."""


# Observations.


@dataclass(frozen=True, eq=False)
class Link:
    """A measured motion of the rig from one node to the next."""

    relative: Pose
    """rig_before_from_rig_now."""
    covariance: Array
    """(6, 6) of the twist (rho, phi) on its right."""
    trusted: bool = True
    """Whether it becomes a factor."""
    decisions: tuple[Decision, ...] = ()
    """About the measurement."""


def link_in_rig(relative: Pose, covariance: Array, rig_from_sensor: Pose) -> Link:
    """Returns a motion of a sensor, with its covariance, as that of the rig."""
    along = rig_from_sensor.adjoint
    return Link(rig_from_sensor @ relative @ rig_from_sensor.inverse(), along @ covariance @ along.T)


def between(poses: Sequence[tuple[int, Pose]], time_ns: int) -> Pose | None:
    """Returns the pose at a time within a path of poses, in the order of time; None outside it."""
    for (start_ns, start), (end_ns, end) in pairwise(poses):
        if start_ns <= time_ns <= end_ns:
            return start @ Pose.exp((time_ns - start_ns) / (end_ns - start_ns) * (start.inverse() @ end).log())
    return None


# Nodes.


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


@dataclass(frozen=True)
class MotionNoise:
    """How certain the motions are that the images give.

    Images distinguish a rotation from a sideways translation only by the parallax of what they show, so an error of the
    rotation is one about the middle of the scene, which the camera moves around.
    """

    turn: float
    """Standard deviation of a rotation, by the root of the time [rad/sqrt(s)]."""
    share: float
    """Of a translation, by its length."""
    scale_walk: float
    """Of the log scale, by the root of the time [1/sqrt(s)]."""
    depth: float = 0.0
    """Of the middle of the scene in the camera, in the unit of the images."""
    walk: float | None = None
    """Of a translation in any direction, by the root of its length [sqrt(unit)]; None where the images do not state it:
    then `share` counts in all directions, else along the motion only."""

    def covariance(self, moved: Pose, metres_per_unit: float, seconds: float) -> Array:
        """Returns (6, 6) of the twist (rho [m], phi) of a motion of the camera, in the unit of the images."""
        about = np.vstack([skew(np.array([0.0, 0.0, metres_per_unit * self.depth])), np.eye(3)])
        turn = self.turn**2 * seconds + LEAST_RAD**2
        along, length = metres_per_unit * moved.translation, float(np.linalg.norm(moved.translation))
        place = np.zeros((6, 6))
        if self.walk is None:
            place[:3, :3] = (self.share * metres_per_unit * length + LEAST_M) ** 2 * np.eye(3)
        else:
            place[:3, :3] = ((metres_per_unit * self.walk) ** 2 * length + LEAST_M**2) * np.eye(3)
            place[:3, :3] += self.share**2 * np.outer(along, along)
        return turn * about @ about.T + place


NO_POINTS = Points(np.zeros(0, np.int64), np.zeros((0, 2), np.float32))


@dataclass(frozen=True, eq=False)
class Node:
    """A time of the window, its estimate, and what was observed there and since the node before."""

    number: int
    time_ns: int
    local_from_rig: Pose = Pose()
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) of the body in the local frame [m/s]."""
    bias: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) accelerometer, gyroscope."""
    log_scale: float = 0.0
    """Logarithm of the metres per unit of the images."""
    offsets: Mapping[str, Array] = field(default_factory=dict)
    """Estimates of the `Offset`s of other sensors, by their names."""
    camera: Pose | None = None
    """world_from_camera of the images, in their unit."""
    visual: Pose | None = None
    """camera_before_from_camera_now, in the unit of the images."""
    noise: MotionNoise | None = None
    """Of `visual`."""
    fresh: bool = False
    """The unit of the images is not that of the node before."""
    relative: Mapping[Kind, Any] = field(default_factory=dict)
    """What sensors observed of the motion since the node before."""
    absolute: Mapping[Kind, Any] = field(default_factory=dict)
    """What sensors observed at the node alone."""
    points: Points = NO_POINTS
    """Of the images, where they enter by their points (tight coupling)."""

    @property
    def motion_sources(self) -> int:
        """Number of sensors, the camera being one, that observed the motion since the node before."""
        return (self.visual is not None) + len(self.relative)

    @property
    def link(self) -> Link | None:
        """The first observed motion as a relative pose, a trusted one if there is one."""
        links = [each for each in self.relative.values() if isinstance(each, Link)]
        return next((each for each in links if each.trusted), links[0] if links else None)

    @property
    def without_absolute(self) -> Node:
        """The node as the end of a motion only: what was observed at it alone would count twice."""
        return replace(self, absolute={})


@dataclass(frozen=True, eq=False)
class NodeContext:
    """What is known when the observations of a new node are made."""

    rig: Rig
    kinds: frozenset[Kind]
    """Those that take part."""
    time_ns: int
    last: Node | None
    """None for the first node."""
    started: bool
    """Whether scale and directions are known; then the estimates of the last node count."""
    path: tuple[tuple[int, Pose], ...]
    """(time_ns, world_from_camera) of recent images, in their unit."""
    camera: Pose | None
    """world_from_camera of the node; None without images."""
    moved: Pose | None
    """rig_before_from_rig_now by the images [m], with the scale of the last node."""
    camera_from_rig: Pose
    slip: float
    """Share by which wheels slip at least."""

    def sensor(self, kind: type[Any]) -> Any:
        """Returns the first sensor of a class on the rig."""
        return sensor_of(self.rig, kind)

    def in_rig(self, relative: Pose, log_scale: float) -> Pose:
        """Returns a motion of the camera in the unit of the images as one of the rig [m]."""
        return motion_in_rig(relative, log_scale, self.camera_from_rig)


def motion_in_rig(relative: Pose, log_scale: float, camera_from_rig: Pose) -> Pose:
    """Returns a motion of the camera in the unit of the images as one of the rig [m]."""
    return camera_from_rig.inverse() @ relative.scaled(np.exp(log_scale)) @ camera_from_rig


def sensor_of(rig: Rig, kind: type[Any]) -> Any:
    """Returns the first sensor of a class on a rig; None where there is none."""
    return next((each for each in rig.sensors.values() if isinstance(each, kind)), None)


# Unknowns of a node.


class Variable:
    """An unknown that each node has: a pose, or numbers with a name."""

    letter: str
    """Of its keys in gtsam."""
    size: int

    def of(self, node: Node, rig_from_body: Pose) -> Any:
        """Returns the estimate of a node, as gtsam has it."""
        raise NotImplementedError

    def put(self, node: Node, value: Any, rig_from_body: Pose) -> Node:
        """Returns the node with another estimate."""
        raise NotImplementedError

    def at(self, values: gtsam.Values, key: int) -> Any:
        """Returns the value of gtsam's values."""
        return values.atVector(key)

    def difference(self, then: Any, now: Any) -> Array:
        """Returns (size,) from one value to another."""
        return now - then

    def first_information(self) -> Array:
        """Returns the information (size, size) of the prior at the first node, where it is always the same."""
        raise NotImplementedError

    def key(self, node: Node) -> int:
        """Returns the key of a node's unknown."""
        import gtsam

        return gtsam.symbol(self.letter, node.number)


class PoseVariable(Variable):
    """The pose of the body."""

    letter, size = "x", 6

    def of(self, node: Node, rig_from_body: Pose) -> Any:
        return pose3(node.local_from_rig @ rig_from_body)

    def put(self, node: Node, value: Any, rig_from_body: Pose) -> Node:
        return replace(node, local_from_rig=Pose.from_matrix(value.matrix()) @ rig_from_body.inverse())

    def at(self, values: gtsam.Values, key: int) -> Any:
        return values.atPose3(key)

    def difference(self, then: Any, now: Any) -> Array:
        return then.localCoordinates(now)


class ScaleVariable(Variable):
    """The logarithm of the scale of the images."""

    letter, size = "s", 1

    def of(self, node: Node, rig_from_body: Pose) -> Any:
        return np.array([node.log_scale])

    def put(self, node: Node, value: Any, rig_from_body: Pose) -> Node:
        return replace(node, log_scale=float(value[0]))


@dataclass(frozen=True)
class Offset(Variable):
    """Numbers that a sensor adds to what it measures, such as a slowly changing bias."""

    name: str
    letter: str
    size: int
    sigma: float
    """Standard deviation at the first node."""
    first: Callable[[Node], Array]
    """Returns the estimate (size,) of a node that has none yet."""

    def of(self, node: Node, rig_from_body: Pose) -> Any:
        return node.offsets[self.name] if self.name in node.offsets else self.first(node)

    def put(self, node: Node, value: Any, rig_from_body: Pose) -> Node:
        return replace(node, offsets={**node.offsets, self.name: value})

    def first_information(self) -> Array:
        return np.eye(self.size) / self.sigma**2


POSE, SCALE = PoseVariable(), ScaleVariable()


# Factors.


@dataclass(frozen=True)
class Loss:
    """A robust loss of gtsam."""

    estimator: str
    """Its name there."""

    def noise(self, covariance: Array) -> gtsam.noiseModel.Base:
        """Returns the noise of a residual under the loss."""
        import gtsam

        model = gtsam.noiseModel
        width = getattr(model.mEstimator, self.estimator).Create(LOSS_WIDTH)
        return model.Robust.Create(width, model.Gaussian.Covariance(covariance))

    def squared(self, cost: float) -> float:
        """Returns the squared residual, in variances, of a cost under the loss."""
        if self.estimator == "Cauchy":
            return LOSS_WIDTH**2 * float(np.expm1(2 * cost / LOSS_WIDTH**2))
        return 2 * cost if cost <= LOSS_WIDTH**2 / 2 else (cost / LOSS_WIDTH + LOSS_WIDTH / 2) ** 2


CAUCHY, HUBER = Loss("Cauchy"), Loss("Huber")


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of gtsam, which sensor made it, and the node to which it leads."""

    sensor: str
    """The kind; or what else made it, such as the prior."""
    value: gtsam.NonlinearFactor
    to: int
    dimensions: int = 0
    """Of the residuals in which the sensor measures something; 0 for what no sensor measured."""
    loss: Loss | None = None

    def squared(self, values: gtsam.Values) -> float:
        """Returns the squared residual, in variances, without the loss."""
        cost = float(self.value.error(values))
        return 2 * cost if self.loss is None else self.loss.squared(cost)


@dataclass(frozen=True, eq=False)
class GraphFrames:
    """The frames of a graph, and the loss of its absolute observations."""

    rig: Rig
    camera_from_rig: Pose
    rig_from_body: Pose
    loss: Loss

    def sensor(self, kind: type[Any]) -> Any:
        """Returns the first sensor of a class on the rig."""
        return sensor_of(self.rig, kind)

    def point_in_body(self, sensor: Sensor) -> Array:
        """Returns the place (3,) of a sensor in the frame of the body [m]."""
        return self.rig_from_body.inverse().apply(sensor.rig_from_sensor.translation)

    def relative_pose(self, sensor: str, link: Link, before: Node, now: Node, loss: Loss | None = CAUCHY) -> Factor:
        """Returns the factor of a motion of the rig from one node to the next."""
        import gtsam

        body_from_rig = self.rig_from_body.inverse()
        along = body_from_rig.adjoint
        covariance = (along @ link.covariance @ along.T)[np.ix_(ORDER, ORDER)]
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance) if loss is None else loss.noise(covariance)
        relative = pose3(body_from_rig @ link.relative @ self.rig_from_body)
        factor = gtsam.BetweenFactorPose3(POSE.key(before), POSE.key(now), relative, noise)
        return Factor(sensor, factor, now.number, 0 if loss is None else 3, loss)


def pose3(pose: Pose) -> gtsam.Pose3:
    """Returns a pose as gtsam has it."""
    import gtsam

    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation)
