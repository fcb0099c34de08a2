"""Corrections of a calibration, as methods find them from the images: named parameters with their covariance."""

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
        """The parameters in their order."""
        return tuple(field.name for field in fields(cls) if field.name != "covariance")

    @classmethod
    def of(cls, values: Array, covariance: Array | None = None) -> Self:
        """Returns the correction of parameters (P,). Raises ValueError where their number or the covariance's shape is
        another one."""
        count = len(cls.names())
        if np.shape(values) != (count,) or (covariance is not None and np.shape(covariance) != (count, count)):
            raise ValueError(f"a {cls.__name__} has {count} parameters, not {np.shape(values)}")
        return cls(*map(float, values), covariance=covariance)  # type: ignore[call-arg]


@dataclass(frozen=True, eq=False)
class LensCorrection(_Correction):
    """Of a camera by itself: an image coordinate is x (1 + focal + radial |x|^2), where x is the right one at z = 1."""

    focal: float = 0.0
    """Correction of the focal length, relative to its value."""
    radial: float = 0.0
    """Correction of the radial distortion k1."""
    covariance: Array | None = None
    """(2, 2); None where it is not known, 0 for a parameter that is held."""


@dataclass(frozen=True, eq=False)
class PairCorrection(_Correction):
    """Of a rectified pair: the lens of both cameras, then what the right camera has in addition. Each parameter moves
    its image by its share of a fixed pattern (`ispom.solvers.right_camera`)."""

    both_k1: float = 0.0
    both_k2: float = 0.0
    """Radial distortion of both cameras."""
    offset_x_rad: float = 0.0
    """To the right in the middle of the image."""
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    """Rotation of the right camera about its own x, y and z axes."""
    focal: float = 0.0
    """Longer focal length of the right camera, relative to its value."""
    k1: float = 0.0
    k2: float = 0.0
    """Radial distortion of the right camera, minus that of both."""
    p1: float = 0.0
    p2: float = 0.0
    """Decentring distortion of the right camera."""
    q1: float = 0.0
    q2: float = 0.0
    """By which decentring grows with the square of the radius."""
    ahead: float = 0.0
    """How much farther ahead the right camera sits, over the baseline."""
    lag_s: float = 0.0
    """Delay of its shutter."""
    offset_y_rad: float = 0.0
    """Down in the middle of the image."""
    down: float = 0.0
    """How much lower the right camera sits, over the baseline."""
    covariance: Array | None = None
    """(17, 17); None where it is not known, 0 for a parameter that is held."""


@dataclass(frozen=True, eq=False)
class MountCorrection(_Correction):
    """Of the video camera on the rig, and of its clock."""

    turn_x_rad: float = 0.0
    turn_y_rad: float = 0.0
    turn_z_rad: float = 0.0
    """Rotation vector about its own axes."""
    shift_x_m: float = 0.0
    shift_y_m: float = 0.0
    shift_z_m: float = 0.0
    """Along the axes of the rig."""
    late_s: float = 0.0
    """Delay of its clock."""
    covariance: Array | None = None
    """(7, 7); None where it is not known, 0 for a parameter that is held."""


@dataclass(frozen=True)
class ImageNoise:
    """Noise of a track's coordinates on the plane z = 1 (standard deviations)."""

    measured: float
    """As the residuals say."""
    effective: float
    """What covariances take it for: neighbouring tracks share a part of it."""


@dataclass(frozen=True, eq=False)
class Corrections:
    """What a method found to be wrong with the calibration so far; None for what it does not correct."""

    lens: LensCorrection | None = None
    """Of the video camera."""
    pair: PairCorrection | None = None
    mount: MountCorrection | None = None
    noise: ImageNoise | None = None
    pair_motion: Array | None = None
    """(6,) the motion during the delay of the right shutter: change of left_from_world on the left, rho [m/s] and phi
    [rad/s]."""

    @property
    def has_covariance(self) -> bool:
        """Checks that a correction has its covariance."""
        return any(c is not None and c.covariance is not None for c in (self.lens, self.pair, self.mount))

    def updated(self, later: Corrections) -> Corrections:
        """Returns these corrections with those that `later` has in their place."""
        values = {field.name: getattr(later, field.name) for field in fields(later)}
        return replace(self, **{name: value for name, value in values.items() if value is not None})
