"""All that is claimed of the sensors of a recording, by the motion of its images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ispom.geometry import Array, rotation_angle_rad, so3_exp
from ispom.sensors.imu import BIAS_SIGMA

from .accelerometer import UNITS as FORCE_UNITS
from .accelerometer import AccelerometerFit, accelerometer_fit, speeds
from .claims import Claim, along, tested
from .fit import Fit
from .gnss import GnssFit, fixes, gnss_fit
from .gyroscope import GyroscopeFit, gyroscope_fit, turns
from .scene import SensorScene
from .wheel import LEAST_S, WheelFit, rolls, wheel_fit

LEAST_CLOCK_S = {"imu": 0.005, "gnss": 0.02, "wheel": 0.02}
"""Least clock offsets that matter: at 1 rad/s and 10 m/s they change rotations by 0.3 degrees and positions by 0.2 m,
as much as the errors of these sensors."""
LEAST_MOUNT_RAD = np.radians(0.5)
"""A mount that was measured by hand or found by a calibration is as good."""
LEAST_ARM_M = {"gnss": 0.3, "wheel": 0.15}
"""A tape measure and a differential receiver are as good."""
LEAST_UNIT = {"gyroscope": 0.15, "accelerometer": 0.15, "gnss": 0.05, "wheel": 0.05, "turn": 0.15}
"""Logarithms of a factor: no unit is another one by less, but for wheels of a wrong size, and wheels' rotations, which
depend on their distance."""
LEAST_BIAS = 2 * BIAS_SIGMA
"""Least bias that matters: twice the standard deviation that `fused` assumes for a calibrated unit."""
DEG_S, DEGREES, M_S2, METRES = (180 / np.pi, "deg/s"), (180 / np.pi, "degrees"), (1.0, "m/s^2"), (1.0, "m")
MIRRORED = (
    "The fixes fit as well with east and north exchanged: turns both to the left and to the right would decide it."
)
UNKNOWN_RAD = 3.0
"""Standard deviation of a mount about an axis about which it does not show."""
WORST_SCALE = 0.1
"""Standard deviation of the logarithm of a scale by the accelerometer with which lengths are compared."""
ALIKE = 3.0
"""Two factors are the same where they differ by at most this many standard deviations."""
UNITS: Mapping[str, Mapping[float, str]] = {
    "gyroscope": {180 / np.pi: "degrees per second", np.pi / 180: "radians per second divided by 57.3"},
    "accelerometer": FORCE_UNITS,
    "gnss": {0.001: "km", 100.0: "cm", 1000.0: "mm", 1 / 0.3048: "feet"},
    "wheel": {3.6: "km/h in place of m/s", 1000.0: "mm", 100.0: "cm", 0.001: "km", 1 / 0.3048: "feet"},
    "turn": {180 / np.pi: "degrees", np.pi / 180: "radians divided by 57.3", -1.0: "the other sign"},
}


@dataclass(frozen=True, eq=False)
class SensorsJudged:
    """The claims by their keys, and further results about the IMU."""

    claims: Mapping[str, Claim] = field(default_factory=dict)
    gyroscope: GyroscopeFit | None = None
    accelerometer: AccelerometerFit | None = None
    gnss: GnssFit | None = None
    wheel: WheelFit | None = None
    gravity: tuple[Array, float] | None = None
    """Direction of gravity (3,) in the rig at the first pose, and its standard deviation [rad]; None where there is no
    accelerometer, or its sign is not known."""

    @property
    def gravity_values(self) -> dict[str, float]:
        """Figures of it by name."""
        if self.gravity is None:
            return {}
        (x, y, z), sigma = self.gravity
        return {
            "gravity_x": float(x),
            "gravity_y": float(y),
            "gravity_z": float(z),
            "gravity_deg_sigma": float(np.degrees(sigma)),
        }


def judged(scene: SensorScene) -> SensorsJudged:
    """Returns the claims; none about sensors with too few measurements. The same scene gives the same claims."""
    found = _of_imu(scene, SensorsJudged())
    scene, sigma = _in_metres(scene, found)
    return _without_rivals(_of_wheel(scene, _of_gnss(scene, found, sigma), sigma))


def _in_metres(scene: SensorScene, found: SensorsJudged) -> tuple[SensorScene, float]:
    """Returns the scene with the unit of the accelerometer, where the images have none and it has no other mistake, and
    the standard deviation of its logarithm."""
    forces, unit = found.accelerometer, found.claims.get("accelerometer-unit")
    if scene.metric or forces is None or unit is None or unit.large:
        return scene, 0.0
    sigma = float(forces.fit.sigmas[10])
    return (scene, 0.0) if sigma > WORST_SCALE else (scene.scaled(float(np.exp(forces.fit.values[10]))), sigma)


def _with(found: SensorsJudged, claims: Iterator[Claim]) -> SensorsJudged:
    return replace(found, claims={**found.claims, **{each.key: each for each in claims}})


def _of_scale(claims: Iterator[Claim], sigma: float) -> Iterator[Claim]:
    """Yields the claims; units are no better known than the scale of the images."""
    return (replace(c, sigma=float(np.hypot(c.sigma, sigma))) if c.key.endswith("-unit") else c for c in claims)


# The IMU.


def _of_imu(scene: SensorScene, found: SensorsJudged) -> SensorsJudged:
    measured = scene.measured("imu")
    if measured is None:
        return found
    name, sensor, readings = measured
    times_s, mount = scene.seconds(readings.times_ns), sensor.rig_from_sensor
    seen = turns(scene.path, times_s, readings.values["rates"], mount.rotation)
    if seen is None:
        return found
    gyroscope = gyroscope_fit(seen)
    values, information = gyroscope.fit.values, _mount_information(gyroscope)
    arm = mount if scene.metric else replace(mount, translation=np.zeros(3))
    forces = speeds(scene.path, times_s, readings.values["forces"], arm, float(values[0]))
    accelerometer = None
    if forces is not None:
        known = values[1:4], information
        accelerometer = accelerometer_fit(forces, scene.metric, known, gyroscope.hidden)
    made = replace(found, gyroscope=gyroscope, accelerometer=accelerometer)
    if accelerometer is not None:
        made = replace(made, gravity=_gravity(scene, accelerometer))
    made = _with(made, _imu_claims(gyroscope, accelerometer, name, mount.rotation))
    unit = made.claims.get("accelerometer-unit")
    return made if unit is None else _with(made, iter([replace(unit, values={**unit.values, **made.gravity_values})]))


def _mount_information(found: GyroscopeFit) -> Array:
    """Returns the gyroscope's information (3, 3) on the mount; it is zero about hidden axes."""
    return np.linalg.inv(_mount_covariance(found))


def _mount_covariance(found: GyroscopeFit) -> Array:
    return found.fit.covariance[1:4, 1:4] + UNKNOWN_RAD**2 * found.hidden.T @ found.hidden


def _gravity(scene: SensorScene, found: AccelerometerFit) -> tuple[Array, float]:
    assert scene.path.rotations is not None
    vector, size = found.fit.values[7:10], float(np.linalg.norm(found.fit.values[7:10]))
    covariance = found.fit.covariance[7:10, 7:10]
    across = np.eye(3) - np.outer(vector, vector) / size**2
    sigma = float(np.sqrt(np.trace(across @ covariance @ across) / 2)) / size
    return scene.path.rotations[0].T @ vector / size, sigma


def _imu_claims(
    gyroscope: GyroscopeFit, accelerometer: AccelerometerFit | None, name: str, stated: Array
) -> Iterator[Claim]:
    fit = gyroscope.fit
    if gyroscope.turns.clock_shows:
        yield tested(fit, [0], _clock("imu", name, fit))
    yield tested(fit, [4], _unit("gyroscope", name, fit, 4))
    size, sigma = along(fit.values[5:8], fit.covariance[5:8, 5:8])
    text = f"The gyroscope of {name} measures {_vector(np.degrees(fit.values[5:8]))} deg/s too much "
    text += f"({np.degrees(size):.3g}, +-{np.degrees(sigma):.2g})"
    values = {"bias_deg_s": float(np.degrees(size)), "bias_deg_s_sigma": float(np.degrees(sigma))}
    values |= {f"bias_{axis}_deg_s": float(np.degrees(v)) for axis, v in zip("xyz", fit.values[5:8], strict=True)}
    yield tested(fit, [5, 6, 7], Claim("gyroscope-bias", name, size, sigma, float(LEAST_BIAS[3]), text, DEG_S, values))
    mount = tested(fit, [1, 2, 3], _mount(name, fit.values[1:4], _mount_covariance(gyroscope), stated))
    if accelerometer is None:
        if len(gyroscope.hidden) < 3:
            yield _of_shown(mount, gyroscope)
        return
    forces = accelerometer.fit
    if not mount.found:
        mount = tested(forces, [3, 4, 5], _mount(name, forces.values[3:6], forces.covariance[3:6, 3:6], stated))
    yield mount
    yield _bias(accelerometer, name)
    if accelerometer.reversed:
        text = f"The forces of {name} fit the motion of the images with their signs reversed only"
        yield Claim("accelerometer-unit", name, 1.0, 0.0, 0.5, text, values={"factor": -1.0})
    else:
        yield _unit("accelerometer", name, forces, 6)


def _of_shown(mount: Claim, found: GyroscopeFit) -> Claim:
    """Returns the claim without the standard deviation about axes about which nothing shows."""
    covariance = found.fit.covariance[1:4, 1:4]
    return replace(mount, sigma=max(along(found.fit.values[1:4], covariance)[1], 1e-9))


def _mount(name: str, vector: Array, covariance: Array, stated: Array) -> Claim:
    size, sigma = along(vector, covariance)
    about = _vector(np.degrees(vector))
    text = (
        f"{name} is mounted {np.degrees(size):.3g} degrees (+-{np.degrees(sigma):.2g}) from what is stated (rotation "
    )
    text += f"vector {about} degrees along the rig's axes)"
    inverse = float(rotation_angle_rad(so3_exp(vector) @ stated @ stated))
    if size > 10 * LEAST_MOUNT_RAD and inverse < max(5 * sigma, LEAST_MOUNT_RAD):
        text += "; it fits if the stated mount is inverted, sensor_from_rig in place of rig_from_sensor"
    sigmas = np.degrees(np.sqrt(np.diag(covariance)))
    values = {"mount_deg": float(np.degrees(size)), "mount_deg_sigma": float(np.degrees(sigma))}
    for axis, value, own in zip("xyz", np.degrees(vector), sigmas, strict=True):
        values |= {f"mount_{axis}_deg": float(value), f"mount_{axis}_deg_sigma": float(own)}
    return Claim("imu-mount", name, size, sigma, float(LEAST_MOUNT_RAD), text, DEGREES, values)


def _bias(found: AccelerometerFit, name: str) -> Claim:
    fit = found.fit
    size, sigma = along(fit.values[:3], fit.covariance[:3, :3])
    text = f"The accelerometer of {name} measures {_vector(fit.values[:3])} m/s^2 too much ({size:.3g}, +-{sigma:.2g})"
    values = {"bias_m_s2": size, "bias_m_s2_sigma": sigma}
    return tested(
        fit, [0, 1, 2], Claim("accelerometer-bias", name, size, sigma, float(LEAST_BIAS[0]), text, M_S2, values)
    )


# All of them.


def _clock(kind: str, name: str, fit: Fit) -> Claim:
    late_s, sigma_s = float(fit.values[0]), float(fit.sigmas[0])
    least = LEAST_CLOCK_S[kind]
    later = "later" if late_s > 0 else "earlier"
    text = (
        f"The time stamps of {name} are {1e3 * abs(late_s):.3g} ms (+-{1e3 * sigma_s:.2g}) {later} than those of the "
    )
    text += f"images: add {-late_s:.4g} s to its clock_offset_s"
    values = {"late_s": late_s, "late_s_sigma": sigma_s}
    return Claim(f"{kind}-clock", name, abs(late_s), sigma_s, least, text, (1e3, "ms"), values)


def _unit(kind: str, name: str, fit: Fit, number: int, key: str = "") -> Claim:
    log_unit, sigma = float(fit.values[number]), float(fit.sigmas[number])
    factor = float(np.exp(log_unit))
    words = {"gyroscope": "rates", "accelerometer": "forces", "gnss": "lengths", "wheel": "ways", "turn": "rotations"}
    text = f"The {words[kind]} of {name} are {factor:.4g} times (+-{100 * sigma:.2g} %) those of the images"
    near = [unit for unit in UNITS[kind] if unit > 0 and abs(log_unit - np.log(unit)) <= 0.1]
    text += f", as of {UNITS[kind][near[0]]}" if near else ""
    values = {"factor": factor, "log_factor_sigma": sigma}
    return Claim(key or f"{kind}-unit", name, abs(log_unit), sigma, LEAST_UNIT[kind], text, (100.0, "%"), values)


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"


# GNSS.


def _of_gnss(scene: SensorScene, found: SensorsJudged, scale_sigma: float) -> SensorsJudged:
    measured = scene.measured("gnss")
    if measured is None:
        return found
    name, sensor, readings = measured
    up = None
    if found.accelerometer is not None and found.accelerometer.sign_known:
        up = -found.accelerometer.fit.values[7:10]
    values, arm = readings.values, sensor.rig_from_sensor.translation
    seen = fixes(scene.path, scene.seconds(readings.times_ns), values["xyz"], values["sigma"], arm, up, scene.metric)
    if seen is None:
        return found
    gnss = gnss_fit(seen, up is not None)
    claims = _gnss_claims(gnss, name, scene.metric)
    if not gnss.axes_known:
        claims = (replace(c, rival=MIRRORED) if c.large and c.key != "gnss-unit" else c for c in claims)
    return _with(replace(found, gnss=gnss), _of_scale(claims, scale_sigma))


def _gnss_claims(found: GnssFit, name: str, metric: bool) -> Iterator[Claim]:
    fit = found.fit
    if found.axes_known:
        text = f"The fixes of {name} fit the path of the images only with east and north exchanged (or latitude and "
        text += "longitude, or one of them with the other sign)"
        right = f"The fixes of {name} fit the path of the images with their axes as they are"
        yield Claim("gnss-axes", name, float(found.exchanged), 0.0, 0.5, text if found.exchanged else right)
    yield tested(fit, [0], _clock("gnss", name, fit))
    size, sigma = along(fit.values[1:4], fit.covariance[1:4, 1:4])
    # What is long but unknown hides what is short and known: the surest axis counts where no vector does.
    k = int(np.argmax(abs(fit.values[1:4]) / fit.sigmas[1:4]))
    if abs(float(fit.values[1 + k])) >= LEAST_ARM_M["gnss"] or sigma > LEAST_ARM_M["gnss"]:
        size, sigma = abs(float(fit.values[1 + k])), float(fit.sigmas[1 + k])
    text = (
        f"The antenna of {name} is {_vector(fit.values[1:4])} m (+-{_vector(fit.sigmas[1:4])[1:-1]}) from where it is "
    )
    text += "stated, along the rig's axes"
    values = {"arm_m": size, "arm_m_sigma": sigma}
    for axis, value, own in zip("xyz", fit.values[1:4], fit.sigmas[1:4], strict=True):
        values |= {f"arm_{axis}_m": float(value), f"arm_{axis}_m_sigma": float(own)}
    yield tested(fit, [1, 2, 3], Claim("gnss-mount", name, size, sigma, LEAST_ARM_M["gnss"], text, METRES, values))
    if metric:
        yield tested(fit, [4], _unit("gnss", name, fit, 4))


# Wheels.


def _of_wheel(scene: SensorScene, found: SensorsJudged, scale_sigma: float) -> SensorsJudged:
    measured = scene.measured("wheel")
    if measured is None or not scene.metric:
        return found
    name, sensor, readings = measured
    given = scene.seconds(readings.times_ns), readings.values["distances"], readings.values.get("turns")
    mount = sensor.rig_from_sensor
    long, short = (rolls(scene.path, *given, mount, length) for length in (None, LEAST_S))
    if long is None or short is None:
        return found
    wheel = wheel_fit(long, short)
    claims = _wheel_claims(wheel, long.clock_shows, name, given[2] is not None)
    return _with(replace(found, wheel=wheel), _of_scale(claims, scale_sigma))


def _wheel_claims(found: WheelFit, clock_shows: bool, name: str, pair: bool) -> Iterator[Claim]:
    clock, fit = found.clock, found.others
    if clock_shows:
        yield tested(clock, [0], _clock("wheel", name, clock))
    yield max((_wheel_angle(fit, name), _wheel_arm(fit, name)), key=lambda claim: claim.strength)
    units = [tested(fit, [4], _unit("wheel", name, fit, 4))]
    if pair:
        units.append(tested(fit, [5], _unit("turn", name, fit, 5, "wheel-unit")))
    yield max(units, key=lambda claim: claim.strength)


def _wheel_angle(fit: Fit, name: str) -> Claim:
    value, sigma = float(fit.values[1]), float(fit.sigmas[1])
    text = (
        f"The wheels of {name} roll {np.degrees(value):.3g} degrees (+-{np.degrees(sigma):.2g}) to the left of where "
    )
    text += "they are stated to"
    values = {"mount_z_deg": float(np.degrees(value)), "mount_z_deg_sigma": float(np.degrees(sigma))}
    return tested(
        fit, [1], Claim("wheel-mount", name, abs(value), sigma, float(LEAST_MOUNT_RAD), text, DEGREES, values)
    )


def _wheel_arm(fit: Fit, name: str) -> Claim:
    k = int(np.argmax(abs(fit.values[2:4]) / np.maximum(fit.sigmas[2:4], 1e-12)))
    value, sigma = float(fit.values[2 + k]), float(fit.sigmas[2 + k])
    way = ("ahead", "to the left")[k]
    text = f"The wheels of {name} are {value:.3g} m (+-{sigma:.2g}) {way} of where they are stated"
    values = {f"arm_{'xy'[k]}_m": value, f"arm_{'xy'[k]}_m_sigma": sigma}
    return tested(
        fit, [2 + k], Claim("wheel-mount", name, abs(value), sigma, LEAST_ARM_M["wheel"], text, METRES, values)
    )


def _without_rivals(found: SensorsJudged) -> SensorsJudged:
    """Fixes and wheels that are too long by the same factor: the unit of the images is wrong, which is neither's."""
    gnss, wheel = (found.claims.get(key) for key in ("gnss-unit", "wheel-unit"))
    if gnss is None or wheel is None or not (gnss.large and wheel.large):
        return found
    gap = np.log(gnss.values["factor"] / wheel.values["factor"])
    if abs(gap) > ALIKE * np.hypot(gnss.sigma, wheel.sigma):
        return found
    rival = (
        "Fixes and wheels differ by the same factor from the images: the baseline of the pair is the likelier cause."
    )
    return _with(found, iter([replace(gnss, rival=rival), replace(wheel, rival=rival)]))
