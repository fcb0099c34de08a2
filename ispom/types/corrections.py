"""Corrections of a calibration that methods estimate from the images: named parameters with their covariance."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from ispom.geometry import Array


@dataclass(frozen=True, eq=False)
class _Correction:
    """Parameters in the order of the fields, and their covariance."""

    @property
    def values(self) -> Array:
        """(P,) the parameters in the order of the covariance."""
        return np.array([getattr(self, name) for name in self.names()], float)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Returns the parameters in their order."""
        return tuple(field.name for field in fields(cls) if field.name != "covariance")

    @classmethod
    def of(cls, values: Array, covariance: Array | None = None) -> Self:
        """Returns the correction with parameters (P,). Raises ValueError for a wrong number of parameters, and for a
        covariance of another shape."""
        count = len(cls.names())
        if np.shape(values) != (count,) or (covariance is not None and np.shape(covariance) != (count, count)):
            raise ValueError(f"a {cls.__name__} has {count} parameters, not {np.shape(values)}")
        return cls(*map(float, values), covariance=covariance)  # type: ignore[call-arg]


@dataclass(frozen=True, eq=False)
class LensCorrection(_Correction):
    """Correction of a single camera: it observes x (1 + focal + radial |x|^2), where x is the correct position at z =
    1."""

    focal: float = 0.0
    """Correction of the focal length, relative to its value."""
    radial: float = 0.0
    """Correction of the radial distortion k1."""
    covariance: Array | None = None
    """(2, 2); None where it is unknown, 0 for a fixed parameter."""


@dataclass(frozen=True, eq=False)
class PairCorrection(_Correction):
    """Correction of a rectified pair: the distortion of both cameras, and the errors of the right one relative to the
    left one. The image shift is linear in the parameters (`ispom.solvers.right_camera`)."""

    both_k1: float = 0.0
    both_k2: float = 0.0
    """Radial distortion of both cameras."""
    offset_x_rad: float = 0.0
    """Shift to the right in the middle of the image."""
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    """Rotation of the right camera about its own x, y and z axes."""
    focal: float = 0.0
    """Relative change of the right camera's focal length."""
    k1: float = 0.0
    k2: float = 0.0
    """Radial distortion of the right camera, minus that of both."""
    p1: float = 0.0
    p2: float = 0.0
    """Decentring distortion of the right camera."""
    q1: float = 0.0
    q2: float = 0.0
    """Growth of the decentring with the square of the radius."""
    ahead: float = 0.0
    """Displacement of the right camera along the optical axis, relative to the baseline."""
    lag_s: float = 0.0
    """Delay of the right camera's shutter."""
    offset_y_rad: float = 0.0
    """Shift down in the middle of the image."""
    down: float = 0.0
    """Displacement of the right camera down, relative to the baseline."""
    covariance: Array | None = None
    """(17, 17); None where it is unknown, 0 for a fixed parameter."""


@dataclass(frozen=True, eq=False)
class MountCorrection(_Correction):
    """Correction of the video camera's pose on the rig, and of its clock."""

    turn_x_rad: float = 0.0
    turn_y_rad: float = 0.0
    turn_z_rad: float = 0.0
    """Rotation vector about its own axes."""
    shift_x_m: float = 0.0
    shift_y_m: float = 0.0
    shift_z_m: float = 0.0
    """Displacement along the axes of the rig."""
    late_s: float = 0.0
    """Delay of its clock."""
    covariance: Array | None = None
    """(7, 7); None where it is unknown, 0 for a fixed parameter."""


@dataclass(frozen=True, eq=False)
class ImuBias(_Correction):
    """What an IMU measures too much, along its own axes."""

    force_x_m_s2: float = 0.0
    force_y_m_s2: float = 0.0
    force_z_m_s2: float = 0.0
    """Bias of the accelerometer."""
    rate_x_rad_s: float = 0.0
    rate_y_rad_s: float = 0.0
    rate_z_rad_s: float = 0.0
    """Bias of the gyroscope."""
    covariance: Array | None = None
    """(6, 6); None where it is unknown."""


@dataclass(frozen=True)
class ClockOffset:
    """Of a sensor, against the images."""

    late_s: float
    """How much later its time stamps are [s]."""
    sigma_s: float


@dataclass(frozen=True, eq=False)
class Gravity:
    """The direction of gravity in the rig, as an IMU shows it."""

    direction: Array
    """(3,) of length 1, down, along the axes of the rig."""
    covariance: Array
    """(3, 3) [rad^2], without any along the direction itself."""


@dataclass(frozen=True)
class ImageNoise:
    """Noise of a track's coordinates on the plane z = 1 (standard deviations)."""

    measured: float
    """From the residuals."""
    effective: float
    """The value used in covariances: neighbouring tracks share a part of the noise."""


@dataclass(frozen=True, eq=False)
class Corrections:
    """A method's current corrections of the calibration; None for those that it does not estimate."""

    lens: LensCorrection | None = None
    """Correction of the video camera."""
    pair: PairCorrection | None = None
    mount: MountCorrection | None = None
    imu: ImuBias | None = None
    gravity: Gravity | None = None
    imu_clock: ClockOffset | None = None
    noise: ImageNoise | None = None
    pair_motion: Array | None = None
    """(6,) velocity during the delay of the right shutter: left twist of left_from_world, rho [m/s] and phi [rad/s]."""

    @property
    def has_covariance(self) -> bool:
        """Checks that a correction has its covariance."""
        return any(c is not None and c.covariance is not None for c in (self.lens, self.pair, self.mount))

    def updated(self, later: Corrections) -> Corrections:
        """Returns these corrections, replaced by those that `later` has."""
        values = {field.name: getattr(later, field.name) for field in fields(later)}
        return replace(self, **{name: value for name, value in values.items() if value is not None})
