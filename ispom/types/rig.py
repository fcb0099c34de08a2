"""Rigs: named sensors, where each of them sits, and how exact it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from ispom.cameras import Camera
from ispom.geometry import Pose
from ispom.types.measurements import CAMERAS, STEREO, VIDEO, Kind

FrameName = str
"""A coordinate frame: world, rig, board, body, or the name of a sensor of the rig."""
POSE_PREFIX, SIGMA_SUFFIX = "rig_from_", "_sigma"


@dataclass(frozen=True)
class LensSigma:
    """Standard deviations of a camera's calibration; 0 where it is exact."""

    focal: float
    """Standard deviation of the focal length, relative to its value."""
    radial: float
    """Standard deviation of the radial distortion k1."""


@dataclass(frozen=True)
class PairSigma:
    """Standard deviations of the calibration of a rectified pair; 0 where it is exact."""

    offset_px: float
    """Standard deviation of disparities and of row differences in the middle of the image."""
    turn_deg: float
    """Standard deviation of the right camera's rotation about each of its axes."""
    focal: float
    """Standard deviation of the right focal length, relative to the left one."""
    radial: float
    """Standard deviation of the radial distortion k1 and k2 of both, and of the right one's difference from it."""
    decentring: float
    """Standard deviation of the right camera's decentring distortion p1 and p2."""
    lag_s: float
    """Standard deviation of the delay of the right shutter."""


EXACT_LENS = LensSigma(0.0, 0.0)
EXACT_PAIR = PairSigma(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor:
    """A sensor of the rig. A package adds a kind of its own by a subclass with another `kind`."""

    kind: ClassVar[Kind] = ""
    """Kind of its measurements."""
    rig_from_sensor: Pose = field(default_factory=Pose)


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraSensor(Sensor):
    """A camera."""

    kind: ClassVar[Kind] = CAMERAS
    camera: Camera
    sigma: LensSigma | None = None
    """Of its calibration; None where that does not say: then settings of the methods do."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Imu(Sensor):
    """An inertial measurement unit, with the continuous-time noise of its white noise and of its biases."""

    kind: ClassVar[Kind] = "imu"
    gyroscope_noise: float = 1e-3
    """[rad/s/sqrt(Hz)]"""
    accelerometer_noise: float = 1e-2
    """[m/s^2/sqrt(Hz)]"""
    gyroscope_walk: float = 1e-5
    """[rad/s^2/sqrt(Hz)]"""
    accelerometer_walk: float = 1e-4
    """[m/s^3/sqrt(Hz)]"""


@dataclass(frozen=True, eq=False, kw_only=True)
class GnssAntenna(Sensor):
    """The antenna of a GNSS receiver; each fix has a covariance of its own."""

    kind: ClassVar[Kind] = "gnss"


@dataclass(frozen=True, eq=False, kw_only=True)
class WheelOdometer(Sensor):
    """A measured wheel, or a pair of wheels; x forward, y to the left, z up at the point where it rolls."""

    kind: ClassVar[Kind] = "wheel"
    distance_noise: float = 0.01
    """Standard deviation of a distance of 1 m [m]; it grows with the root of the distance."""
    rotation_noise_rad: float = 0.01
    """Standard deviation of the rotation within 1 m [rad], likewise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserScanner(Sensor):
    """A laser scanner or profiler."""

    kind: ClassVar[Kind] = "laser"
    range_noise_m: float = 0.02
    """Standard deviation of a range [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """The sensors of the platform by name. `left` and `right` are a rectified stereo pair: one K, rows aligned,
    undistorted."""

    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    pair_sigma: PairSigma | None = None
    """Standard deviations of the pair's calibration; None where they are unknown."""

    def __repr__(self) -> str:
        cameras = (f"{name} {camera.width}x{camera.height}" for name, camera in self.cameras.items())
        return f"Rig({', '.join([*cameras, *(name for name in self.sensors if name not in self.cameras)])})"

    @staticmethod
    def of(**values: Any) -> Rig:
        """Returns a rig of sensors by keyword, as in `Rig.of(video=camera, rig_from_video=pose)`.

        Each is a Camera or a Sensor. `rig_from_NAME` is the pose of one of them (the identity where it is not given),
        and `NAME_sigma` is the LensSigma of a camera; `pair_sigma` is that of the pair.
        """
        return Rig().changed(**values)

    @staticmethod
    def stereo(left: Camera, baseline_m: float) -> Rig:
        """Returns a rectified pair alone: the rig frame is centred on the baseline (Fig. 6), with the left camera's
        axes."""
        half = np.array([baseline_m / 2, 0, 0])
        poses = {"rig_from_left": Pose(translation=-half), "rig_from_right": Pose(translation=half)}
        return Rig.of(left=left, right=left, **poses)

    @staticmethod
    def single(video: Camera) -> Rig:
        """Returns a video camera alone: it is the rig."""
        return Rig.of(video=video)

    def changed(self, /, **values: Any) -> Rig:
        """Returns the rig with other values, named as in `of`; None removes a sensor.

        Raises KeyError for the pose of a sensor that the rig lacks, TypeError for what is no sensor.
        """
        pair_sigma = values.pop("pair_sigma", self.pair_sigma)
        sensors = dict(self.sensors)
        poses = {k.removeprefix(POSE_PREFIX): values.pop(k) for k in [*values] if k.startswith(POSE_PREFIX)}
        sigmas = {k.removesuffix(SIGMA_SUFFIX): values.pop(k) for k in [*values] if k.endswith(SIGMA_SUFFIX)}
        for name, value in values.items():
            old = sensors.pop(name, None)
            if isinstance(value, Camera):
                camera_sensor = old if isinstance(old, CameraSensor) else CameraSensor(camera=value)
                sensors[name] = replace(camera_sensor, camera=value)
            elif isinstance(value, Sensor):
                sensors[name] = value
            elif value is not None:
                raise TypeError(f"sensor {name} is neither a Camera nor a Sensor, but a {type(value).__name__}")
        for name, pose in poses.items():
            sensors[name] = replace(sensors[name], rig_from_sensor=pose)
        for name, sigma in sigmas.items():
            if isinstance(sensor := sensors.get(name), CameraSensor):
                sensors[name] = replace(sensor, sigma=sigma)
        return Rig(sensors, pair_sigma)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """All cameras by name."""
        return {name: s.camera for name, s in self.sensors.items() if isinstance(s, CameraSensor)}

    @property
    def video(self) -> Camera | None:
        return self.cameras.get("video")

    @property
    def left(self) -> Camera | None:
        return self.cameras.get("left")

    @property
    def right(self) -> Camera | None:
        return self.cameras.get("right")

    @property
    def rig_from_video(self) -> Pose:
        return self.rig_from("video")

    @property
    def rig_from_left(self) -> Pose:
        return self.rig_from("left")

    @property
    def rig_from_right(self) -> Pose:
        return self.rig_from("right")

    @property
    def rig_from_laser(self) -> Pose | None:
        """None where the rig has no laser scanner of that name."""
        return self.sensors["laser"].rig_from_sensor if "laser" in self.sensors else None

    @property
    def video_sigma(self) -> LensSigma | None:
        """Standard deviations of the video camera's calibration; None where they are unknown."""
        sensor = self.sensors.get("video")
        return sensor.sigma if isinstance(sensor, CameraSensor) else None

    @property
    def has_stereo(self) -> bool:
        return self.left is not None and self.right is not None

    @property
    def baseline_m(self) -> float:
        """Distance of the right camera from the left one along the left x axis."""
        return float((self.rig_from_left.inverse() @ self.rig_from_right).translation[0])

    def has(self, kind: Kind) -> bool:
        """Checks that the rig has the sensors for a kind of measurements. Frames of the kind `cameras` are those of
        rigs with a camera that is neither the video camera nor one of the pair."""
        if kind == VIDEO:
            return self.video is not None
        if kind == CAMERAS:
            return bool(self.cameras.keys() - {"video", "left", "right"})
        return self.has_stereo if kind == STEREO else any(s.kind == kind for s in self.sensors.values())

    def camera(self, name: FrameName) -> Camera:
        """Returns a camera. Raises KeyError where the rig has none of this name."""
        if not isinstance(sensor := self.sensors.get(name), CameraSensor):
            raise KeyError(f"this rig has no {name} camera")
        return sensor.camera

    def rig_from(self, frame: FrameName) -> Pose:
        """Returns rig_from_FRAME of a sensor; the identity for the rig itself, and for a video camera or a camera of
        the pair that the rig lacks (a recording may hold poses of it). Raises KeyError for other names."""
        if frame in self.sensors:
            return self.sensors[frame].rig_from_sensor
        if frame in ("rig", "video", "left", "right"):
            return Pose()
        raise KeyError(f"this rig has no sensor {frame}")

    def with_others_of(self, rig: Rig) -> Rig:
        """Returns this rig with the other sensors (all but its cameras) and the standard deviations of `rig`."""
        sensors = {**{n: s for n, s in rig.sensors.items() if not isinstance(s, CameraSensor)}, **self.sensors}
        sigmas = {f"{n}_sigma": s.sigma for n, s in rig.sensors.items() if isinstance(s, CameraSensor)}
        return Rig(sensors, rig.pair_sigma).changed(**sigmas)
