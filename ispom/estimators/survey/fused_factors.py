"""The factors of `fused` in gtsam, made of numbers: preintegrated IMU, antenna positions, and relative poses.

Poses are those of the body: of the IMU where one takes part, so that its lever arm is exact, else of the rig. The local
frame is east, north, up, or of any heading without GNSS.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ispom.estimators.survey.fused_links import Fix, Link
from ispom.estimators.survey.fused_values import Node, Noise, Prior
from ispom.geometry import Array, Pose, skew, so3_log
from ispom.types import Imu, Rig

ORDER = np.array([3, 4, 5, 0, 1, 2])
"""Twists of gtsam are (phi, rho), those here (rho, phi)."""
SIZES = {"x": 6, "v": 3, "b": 6, "s": 1}
DIMENSIONS = {"visual": 6, "imu": 9, "gnss": 3, "wheel": 3, "laser": 3}
"""Of the residuals of one factor, in which the sensor measures something."""
LOSS = 2.0
"""Width of the Cauchy loss of fixes and relative poses [standard deviations]."""
GRAVITY_M_S2 = 9.81
BLIND = np.diag([50.0, 50.0, 50.0, 0.5, 0.5, 0.5]) ** 2
"""Covariance of a motion that nothing measured."""
FRESH = 1.0
"""Standard deviation of the change of the log scale where the images begin anew."""


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of gtsam, which sensor made it, and the node to which it leads."""

    sensor: str
    value: Any
    to: int
    robust: bool = True

    def misfit(self, values: Any) -> float:
        """Returns the squared residual, in variances, without the loss."""
        cost = float(self.value.error(values))
        return LOSS**2 * float(np.expm1(2 * cost / LOSS**2)) if self.robust else 2 * cost


class Factors:
    """Makes the factors of a window, and its values."""

    def __init__(self, rig: Rig, sensors: frozenset[str], camera_from_rig: Pose, noise: Noise) -> None:
        imu = next((s for s in rig.sensors.values() if isinstance(s, Imu)), None) if "imu" in sensors else None
        self.imu, self.sensors, self.noise = imu, sensors, noise
        self.camera_from_rig = camera_from_rig
        self.rig_from_body = Pose() if imu is None else imu.rig_from_sensor
        self.letters = "xvbs" if imu is not None else "xs"
        self.starts = dict(zip(self.letters, np.cumsum([0, *(SIZES[c] for c in self.letters)]), strict=False))
        self.size = sum(SIZES[c] for c in self.letters)

    def factors(self, nodes: tuple[Node, ...], prior: Prior) -> list[Factor]:
        """Returns all factors of a window."""
        import gtsam

        found = [Factor("prior", self._prior(prior), nodes[0].number, False)]
        for before, now in zip((None, *nodes), nodes, strict=False):
            found += [Factor("gnss", self._fix(fix, now), now.number) for fix in now.fixes if "gnss" in self.sensors]
            if before is None:
                continue
            i, j = before.number, now.number
            seconds = (now.time_ns - before.time_ns) * 1e-9
            walk = FRESH if now.fresh else self.noise.scale_walk * np.sqrt(seconds)
            keep = gtsam.noiseModel.Isotropic.Sigma(1, walk)
            keys = gtsam.symbol("s", i), gtsam.symbol("s", j)
            found.append(Factor("scale", gtsam.BetweenFactorVector(*keys, np.zeros(1), keep), j, False))
            if now.visual is not None:
                found.append(Factor("visual", self._visual(now, seconds, i, j), j))
            for name, link in (("wheel", None if now.slipped else now.wheel), ("laser", now.laser)):
                if link is not None and name in self.sensors:
                    found.append(Factor(name, self._relative(link, i, j), j))
            if self.imu is not None:
                found += self._inertial(before, now, self.imu, seconds)
            if now.blind:
                found.append(Factor("blind", self._relative(Link(Pose(), BLIND), i, j, robust=False), j, False))
        return found

    def _inertial(self, before: Node, now: Node, imu: Imu, seconds: float) -> list[Factor]:
        import gtsam

        i, j, model = before.number, now.number, gtsam.noiseModel
        x, v, b = ((gtsam.symbol(c, i), gtsam.symbol(c, j)) for c in "xvb")
        if now.inertial is None:
            walk = np.repeat([imu.accelerometer_walk, imu.gyroscope_walk], 3) * np.sqrt(seconds)
            bias = gtsam.BetweenFactorConstantBias(*b, gtsam.imuBias.ConstantBias(), model.Diagonal.Sigmas(walk))
            speed = gtsam.PriorFactorVector(v[1], now.velocity, model.Isotropic.Sigma(3, 5.0))
            return [Factor("blind", bias, j, False), Factor("blind", speed, j, False)]
        parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(GRAVITY_M_S2)
        parameters.setAccelerometerCovariance(np.eye(3) * imu.accelerometer_noise**2)
        parameters.setGyroscopeCovariance(np.eye(3) * imu.gyroscope_noise**2)
        parameters.setBiasAccCovariance(np.eye(3) * imu.accelerometer_walk**2)
        parameters.setBiasOmegaCovariance(np.eye(3) * imu.gyroscope_walk**2)
        parameters.setIntegrationCovariance(np.eye(3) * 1e-8)
        summed = gtsam.PreintegratedCombinedMeasurements(parameters, _bias(before.bias))
        samples = now.inertial
        for dt, rate, force in zip(samples.seconds.tolist(), samples.rates, samples.forces, strict=True):
            summed.integrateMeasurement(force, rate, dt)
        return [Factor("imu", gtsam.CombinedImuFactor(x[0], v[0], x[1], v[1], *b, summed), j, False)]

    def robust(self, covariance: Array) -> Any:
        """Returns the noise of a fix."""
        return _robust(covariance)

    def _fix(self, fix: Fix, node: Node) -> Any:
        """Of an antenna at the time of the fix, by the motion of the images from there to the node."""
        import gtsam

        antenna = self.camera_from_rig.apply(fix.antenna_in_rig)
        antenna = fix.camera_from_then.scaled(np.exp(node.log_scale)).apply(antenna)
        arm = (self.rig_from_body.inverse() @ self.camera_from_rig.inverse()).apply(antenna)
        return gtsam.GPSFactorArm(gtsam.symbol("x", node.number), fix.xyz_in_local, arm, self.robust(fix.covariance))

    def _relative(self, link: Link, i: int, j: int, robust: bool = True) -> Any:
        import gtsam

        body_from_rig = self.rig_from_body.inverse()
        along = body_from_rig.adjoint
        covariance = (along @ link.covariance @ along.T)[np.ix_(ORDER, ORDER)]
        noise = _robust(covariance) if robust else gtsam.noiseModel.Gaussian.Covariance(covariance)
        relative = pose3(body_from_rig @ link.relative @ self.rig_from_body)
        return gtsam.BetweenFactorPose3(gtsam.symbol("x", i), gtsam.symbol("x", j), relative, noise)

    def _visual(self, node: Node, seconds: float, i: int, j: int) -> Any:
        """Residuals: the rotation, and the translation [m] times the scale at the node."""
        import gtsam

        relative = node.visual
        assert relative is not None
        body_from_camera = self.rig_from_body.inverse() @ self.camera_from_rig.inverse()
        to_camera = body_from_camera.inverse().adjoint[np.ix_(ORDER, ORDER)]
        keys = [gtsam.symbol("x", i), gtsam.symbol("x", j), gtsam.symbol("s", j)]
        length = float(np.exp(node.log_scale) * np.linalg.norm(relative.translation))
        covariance = self.noise.covariance(length, seconds)[np.ix_(ORDER, ORDER)]

        def error(this: Any, values: Any, jacobians: Any) -> Array:
            first, second = (Pose.from_matrix(values.atPose3(k).matrix()) @ body_from_camera for k in keys[:2])
            moved, scale = first.inverse() @ second, np.exp(values.atVector(keys[2])[0])
            if jacobians is not None:
                by_first, by_second = np.zeros((6, 6)), np.zeros((6, 6))
                by_first[:3, :3], by_second[:3, :3] = -moved.rotation.T, np.eye(3)
                by_first[3:, :3], by_first[3:, 3:], by_second[3:, 3:] = (
                    skew(moved.translation),
                    -np.eye(3),
                    moved.rotation,
                )
                jacobians[0], jacobians[1] = by_first @ to_camera, by_second @ to_camera
                jacobians[2] = np.concatenate([np.zeros(3), -scale * relative.translation])[:, None]
            turn = so3_log(relative.rotation.T @ moved.rotation)
            return np.concatenate([turn, moved.translation - scale * relative.translation])

        return gtsam.CustomFactor(_robust(covariance), keys, cast(Any, error))

    def _prior(self, prior: Prior) -> Any:
        import gtsam

        sizes, turned = np.linalg.eigh(prior.information)
        known = sizes > 1e-12 * sizes[-1]
        root = np.sqrt(sizes[known])[:, None] * turned[:, known].T
        side = turned[:, known].T @ prior.vector / np.sqrt(sizes[known])
        keys = [gtsam.symbol(c, prior.at.number) for c in self.letters]
        at, parts = self._parts(prior.at), [self.starts[c] for c in self.letters]

        def error(this: Any, values: Any, jacobians: Any) -> Array:
            difference = list[Array]()
            for letter, key in zip(self.letters, keys, strict=True):
                read: Callable[[int], Any] = {"x": values.atPose3, "b": values.atConstantBias}.get(
                    letter, values.atVector
                )
                now = read(key)
                if letter == "x":
                    difference.append(at["x"].localCoordinates(now))
                else:
                    difference.append(now.vector() - at["b"].vector() if letter == "b" else now - at[letter])
            if jacobians is not None:
                for n, part in enumerate(parts):
                    jacobians[n] = root[:, part : part + SIZES[self.letters[n]]]
            return root @ np.concatenate(difference) - side

        return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(int(known.sum())), keys, cast(Any, error))

    def _parts(self, node: Node) -> dict[str, Any]:
        return {
            "x": pose3(node.local_from_rig @ self.rig_from_body),
            "v": node.velocity,
            "b": _bias(node.bias),
            "s": np.array([node.log_scale]),
        }

    def values(self, nodes: tuple[Node, ...]) -> Any:
        import gtsam

        values = gtsam.Values()
        for node in nodes:
            parts = self._parts(node)
            for letter in self.letters:
                values.insert(gtsam.symbol(letter, node.number), parts[letter])
        return values

    def node(self, node: Node, values: Any) -> Node:
        import gtsam

        key = {c: gtsam.symbol(c, node.number) for c in self.letters}
        pose = Pose.from_matrix(values.atPose3(key["x"]).matrix()) @ self.rig_from_body.inverse()
        found = replace(node, local_from_rig=pose)
        if "s" in key:
            found = replace(found, log_scale=float(values.atVector(key["s"])[0]))
        if self.imu is None:
            return found
        return replace(found, velocity=values.atVector(key["v"]), bias=values.atConstantBias(key["b"]).vector())


def _robust(covariance: Array) -> Any:
    import gtsam

    model = gtsam.noiseModel
    return model.Robust.Create(model.mEstimator.Cauchy.Create(LOSS), model.Gaussian.Covariance(covariance))


def _bias(values: Array) -> Any:
    import gtsam

    return gtsam.imuBias.ConstantBias(values[:3], values[3:])


def pose3(pose: Pose) -> Any:
    import gtsam

    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation)
