"""The factor graph of `fused.tight`: nodes with pose, velocity and biases, and the points that several of them see.

A track is one smart factor: gtsam triangulates its point at each iteration and eliminates it (Carlone et al. 2014), so
that points are no unknowns. A node that leaves takes with it what it and its tracks say about the others: their joint
information on the nodes that stay (Schur complement). Those observations are spent; the tracks go on as new ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ispom.estimators.survey.fused_factors import BLIND, DIMENSIONS, ORDER, SIZES, Factor, Factors, pose3
from ispom.estimators.survey.fused_graph import BIAS_PRIOR, GAUGE, SPEED_PRIOR, TILTED, UNPLACED_M, UNTURNED
from ispom.estimators.survey.fused_links import Link
from ispom.estimators.survey.fused_values import NO_POINTS, Node, Noise
from ispom.geometry import Array, Pose
from ispom.types import Rig

ITERATIONS = 15
RELAXED = 1e-4
"""Information where nothing holds a parameter: 100 m, m/s or rad."""
OUTLIER = 4.0
"""A track whose mean reprojection error exceeds so many standard deviations of its noise is an outlier."""
PARALLAX = 8.0
"""Directions to a point of a track that takes part differ by so many standard deviations of its noise."""
FEWEST_VIEWS = 3
"""Nodes that see a track that takes part."""


@dataclass(frozen=True, eq=False)
class TightPrior:
    """What is known of the nodes of the window by all that left it."""

    at: tuple[Node, ...]
    """Where it is linear."""
    information: Array
    """(K D, K D) of the K nodes."""
    vector: Array
    """(K D,) information times the most likely difference."""
    without: Mapping[str, Array]
    """(K D, K D) information without each sensor."""


@dataclass(frozen=True, eq=False)
class Track(Factor):
    """The factor of a track."""

    ids: int = 0
    numbers: tuple[int, ...] = ()
    """Of the nodes that see it."""


class TightGraph(Factors):
    """Estimates the nodes of a window with their points."""

    def __init__(self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, noise_px: float) -> None:
        import gtsam

        super().__init__(rig, sensors, camera_from_rig, Noise(0.0, 0.0, 0.0))
        self.letters = "xvb" if self.imu is not None else "x"
        self.starts = dict(zip(self.letters, np.cumsum([0, *(SIZES[c] for c in self.letters)]), strict=False))
        self.size = sum(SIZES[c] for c in self.letters)
        camera = rig.camera("video")
        self._sigma = noise_px / np.sqrt(camera.fx * camera.fy)
        self._body_from_camera = pose3((camera_from_rig @ self.rig_from_body).inverse())
        parameters = gtsam.SmartProjectionParams()
        parameters.setDegeneracyMode(gtsam.DegeneracyMode.ZERO_ON_DEGENERACY)
        parameters.setRankTolerance(1e-9)
        parameters.setDynamicOutlierRejectionThreshold(OUTLIER * self._sigma)
        self._parameters, self._lens = parameters, gtsam.Cal3_S2(1.0, 1.0, 0.0, 0.0, 0.0)
        self._noise = gtsam.noiseModel.Isotropic.Sigma(2, self._sigma)

    def first_prior(self, node: Node, still: bool) -> TightPrior:
        """Returns the prior of a first node; `still`: the rig stands, so that its velocity is zero."""
        place, heading = (UNPLACED_M, UNTURNED) if "gnss" in self.sensors else (GAUGE, GAUGE)
        up = node.local_from_rig.rotation.T @ np.array([0.0, 0.0, 1.0])
        turn = TILTED**2 * np.eye(3) + (heading**2 - TILTED**2) * np.outer(up, up)
        return self.known_prior(node, np.asarray(block_diag(place**2 * np.eye(3), turn)), still)

    def known_prior(self, node: Node, covariance: Array, still: bool = False) -> TightPrior:
        """Returns the prior of a node, with the covariance (6, 6) of its twist."""
        along = self.rig_from_body.inverse().adjoint
        covariance = along @ covariance @ along.T
        speed = STILL_M_S if still else SPEED_PRIOR
        parts = {
            "x": np.linalg.inv(covariance[np.ix_(ORDER, ORDER)]),
            "v": np.eye(3) / speed**2,
            "b": np.diag(BIAS_PRIOR**-2.0),
        }
        information = np.asarray(block_diag(*(parts[c] for c in self.letters)), float)
        return TightPrior((node,), information, np.zeros(self.size), dict.fromkeys(sorted(self.sensors), information))

    def window_factors(self, nodes: tuple[Node, ...], prior: TightPrior) -> list[Factor]:
        """Returns all factors of a window."""
        found = [Factor("prior", self._joint_prior(prior), nodes[0].number, False)]
        for before, now in zip((None, *nodes), nodes, strict=False):
            found += self._pair(before, now)
        return [*found, *self._tracks(nodes)]

    def _pair(self, before: Node | None, now: Node) -> list[Factor]:
        """Returns the factors from one node to the next, and those of the latter's fixes."""
        found = [Factor("gnss", self._fix(fix, now), now.number) for fix in now.fixes if "gnss" in self.sensors]
        if before is not None and self.imu is not None:
            found += self._inertial(before, now, self.imu, (now.time_ns - before.time_ns) * 1e-9)
        if before is not None and (self.imu is None or now.inertial is None):
            link = Link(before.local_from_rig.inverse() @ now.local_from_rig, BLIND)
            found.append(Factor("blind", self._relative(link, before.number, now.number, False), now.number, False))
        return found

    def _tracks(self, nodes: tuple[Node, ...]) -> list[Factor]:
        """Returns the factors of all tracks that enough of the nodes see."""
        import gtsam

        ids = np.concatenate([n.points.ids for n in nodes])
        xy = np.concatenate([n.points.xy for n in nodes]).astype(float)
        counts = [len(n.points) for n in nodes]
        number = np.repeat([n.number for n in nodes], counts)
        to_camera = np.array(self._body_from_camera.rotation().matrix())
        turns = np.array([(n.local_from_rig @ self.rig_from_body).rotation @ to_camera for n in nodes])
        rays = np.einsum("nij,nj->ni", np.repeat(turns, counts, axis=0), np.hstack([xy, np.ones((len(xy), 1))]))
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        order = np.argsort(ids, kind="stable")
        several, begins = np.unique(ids[order], return_index=True)
        found = list[Factor]()
        for track, part in zip(several.tolist(), np.split(order, begins[1:]), strict=True):
            if len(part) < FEWEST_VIEWS:
                continue
            if np.linalg.norm(rays[part] - rays[part[0]], axis=1).max() < PARALLAX * self._sigma:
                continue
            factor = gtsam.SmartProjectionPoseFactorCal3_S2(
                self._noise, self._lens, self._body_from_camera, self._parameters
            )
            for i in part.tolist():
                factor.add(xy[i], gtsam.symbol("x", int(number[i])))
            found.append(Track("visual", factor, int(number[part[-1]]), False, track, tuple(number[part].tolist())))
        return found

    def optimised(self, nodes: tuple[Node, ...], prior: TightPrior) -> tuple[tuple[Node, ...], dict[str, float]]:
        """Returns the most likely nodes, and by sensor the RMS residual of its last factors [standard deviations]."""
        import gtsam

        factors, values = self.window_factors(nodes, prior), self.values(nodes)
        graph = gtsam.NonlinearFactorGraph()
        for factor in factors:
            graph.add(factor.value)
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(ITERATIONS)
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        found = tuple(self.node(node, values) for node in nodes)
        misfits, last = dict[str, list[float]](), nodes[-1].number
        for f in factors:
            if isinstance(f, Track) and f.to == last:
                misfits.setdefault("visual", []).append(f.misfit(values) / (2 * len(f.numbers) - 3))
            elif f.sensor in DIMENSIONS and f.sensor != "visual":
                misfits.setdefault(f.sensor, []).append(f.misfit(values) / DIMENSIONS[f.sensor])
        recent = {sensor: some if sensor == "visual" else some[-6:] for sensor, some in misfits.items()}
        return found, {sensor: float(np.sqrt(np.mean(some))) for sensor, some in recent.items()}

    def reduced(self, nodes: tuple[Node, ...], prior: TightPrior) -> tuple[TightPrior, tuple[Node, ...]]:
        """Returns the prior of the others once the first node leaves the window, and those others."""
        spent = nodes[0].points.ids
        leaving = [Factor("prior", self._joint_prior(prior), nodes[0].number, False)]
        leaving += [f for f in self._pair(None, nodes[0])]
        leaving += [f for f in self._pair(nodes[0], replace(nodes[1], fixes=()))]
        leaving += [f for f in self._tracks(nodes) if isinstance(f, Track) and nodes[0].number in f.numbers]
        parts = self._dense(nodes, leaving)
        information, vector = _eliminated(*_sum(parts), self.size)
        without = dict[str, Array]()
        for sensor, start in prior.without.items():
            matrix, side = _sum(parts, (sensor, "prior"))
            matrix = matrix.copy()
            matrix[: len(start), : len(start)] += start
            without[sensor] = _eliminated(matrix, side, self.size)[0]
        others = tuple(replace(n, points=n.points.without(spent)) for n in nodes[1:])
        at = tuple(replace(n, points=NO_POINTS) for n in others)
        return TightPrior(at, information, vector, without), others

    def uncertainty(self, nodes: tuple[Node, ...], prior: TightPrior) -> tuple[Array, float, dict[str, float]]:
        """Returns of the last node the covariance (6, 6) of the rig's pose, the standard deviation of its velocity (0
        without an IMU) [m/s], and by sensor the factor by which its position would be less certain without it."""
        parts = self._dense(nodes, self.window_factors(nodes, prior))
        covariance, place = self._last(_sum(parts)[0]), slice(3, 6)
        speed = np.sqrt(np.trace(covariance[6:9, 6:9]) / 3) if self.imu is not None else 0.0
        own, gain = np.sqrt(np.trace(covariance[place, place])), dict[str, float]()
        for sensor, start in prior.without.items():
            matrix = _sum(parts, (sensor, "prior"))[0].copy()
            matrix[: len(start), : len(start)] += start
            gain[sensor] = float(np.sqrt(np.trace(self._last(matrix)[place, place])) / own)
        along = self.rig_from_body.adjoint
        pose = along @ covariance[np.ix_(ORDER, ORDER)] @ along.T
        return 0.5 * (pose + pose.T), float(speed), gain

    def _last(self, information: Array) -> Array:
        """Returns the covariance (D, D) of the last node."""
        whole = information + RELAXED * np.eye(len(information))
        if not np.isfinite(whole).all() or (np.diag(whole)<=0).any() or np.linalg.cond(whole)>1e18: print("DBG", np.isfinite(whole).all(), np.diag(whole).min(), np.abs(whole).max())
        scale = 1 / np.sqrt(np.diag(whole))
        columns = np.eye(len(whole))[:, -self.size :]
        solved = np.linalg.solve(whole * np.outer(scale, scale), scale[:, None] * columns)
        return (scale[:, None] * solved)[-self.size :]

    def _dense(self, nodes: tuple[Node, ...], factors: list[Factor]) -> dict[str, tuple[Array, Array]]:
        """Returns by sensor the information (K D, K D) and the vector (K D,) of all nodes."""
        values, size = self.values(nodes), self.size
        place = {node.number: i * size for i, node in enumerate(nodes)}
        found = dict[str, tuple[Array, Array]]()
        for factor in factors:
            linear = factor.value.linearize(values)
            if linear is None or linear.empty():
                continue
            index = list[int]()
            for key in linear.keys():  # noqa: SIM118 (a method of gtsam)
                letter = chr(key >> 56)
                begin = place[key & ((1 << 56) - 1)] + int(self.starts[letter])
                index += range(begin, begin + SIZES[letter])
            whole = linear.augmentedInformation()
            if not np.isfinite(whole).all() or np.abs(whole).max()>1e12: print("DBG", factor.sensor, np.abs(whole).max(), np.linalg.eigvalsh(whole[:-1,:-1])[:3])
            if factor.sensor not in found:
                found[factor.sensor] = np.zeros((size * len(nodes),) * 2), np.zeros(size * len(nodes))
            information, vector = found[factor.sensor]
            information[np.ix_(index, index)] += whole[:-1, :-1]
            vector[index] += whole[:-1, -1]
        return found

    def _joint_prior(self, prior: TightPrior) -> Any:
        import gtsam

        sizes, turned = np.linalg.eigh(prior.information)
        known = sizes > max(1e-12 * sizes[-1], 1e-9)
        root = np.sqrt(sizes[known])[:, None] * turned[:, known].T
        side = turned[:, known].T @ prior.vector / np.sqrt(sizes[known])
        keys = [gtsam.symbol(c, n.number) for n in prior.at for c in self.letters]
        at = [self._parts(n)[c] for n in prior.at for c in self.letters]
        widths = np.cumsum([0, *(SIZES[c] for _ in prior.at for c in self.letters)]).tolist()
        letters = [c for _ in prior.at for c in self.letters]

        def error(this: Any, values: Any, jacobians: Any) -> Array:
            difference = list[Array]()
            for letter, key, then in zip(letters, keys, at, strict=True):
                if letter == "x":
                    difference.append(then.localCoordinates(values.atPose3(key)))
                elif letter == "b":
                    difference.append(values.atConstantBias(key).vector() - then.vector())
                else:
                    difference.append(values.atVector(key) - then)
            if jacobians is not None:
                for n in range(len(keys)):
                    jacobians[n] = root[:, widths[n] : widths[n + 1]]
            return root @ np.concatenate(difference) - side

        return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(int(known.sum())), keys, cast(Any, error))


STILL_M_S = 0.02
"""Standard deviation of the velocity of a rig that stands [m/s]: its points move by less than a pixel in a second."""

def _sum(parts: dict[str, tuple[Array, Array]], without: tuple[str, ...] = ()) -> tuple[Array, Array]:
    whole = next(iter(parts.values()))
    information, vector = np.zeros_like(whole[0]), np.zeros_like(whole[1])
    for sensor, (matrix, side) in parts.items():
        if sensor not in without:
            information += matrix
            vector += side
    return information, vector


def _eliminated(matrix: Array, vector: Array, size: int) -> tuple[Array, Array]:
    """Returns information and vector of what follows the first `size` parameters."""
    first = matrix[:size, :size] + RELAXED * np.eye(size)
    gain = np.linalg.solve(first, matrix[:size, size:]).T
    left = matrix[size:, size:] - gain @ matrix[:size, size:]
    return 0.5 * (left + left.T), vector[size:] - gain @ vector[:size]
