"""Measurements: what the sensors of a rig recorded, each at its time on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeGuard

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array

Image = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) RGB, uint8; pixel (0, 0) is the centre of the top-left pixel."""

Kind = str
"""Kind of a measurement: `video`, `stereo` or `cameras` (a Frame), `imu`, `gnss`, `wheel`, `laser`, or one that a
package defines."""
VIDEO: Kind = "video"
STEREO: Kind = "stereo"
CAMERAS: Kind = "cameras"
FRAME_KINDS = frozenset({VIDEO, STEREO, CAMERAS})


@dataclass(frozen=True, eq=False)
class Measurement:
    """The base of all measurements. A package adds its own kind by a subclass with another `kind`."""

    time_ns: int
    """Time at which it was complete [ns]; streams are ordered by it."""

    @property
    def kind(self) -> Kind:
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class Frame(Measurement):
    """The images that one or several cameras recorded at one time."""

    images: Mapping[str, Image]
    """By camera name. `video` alone is a video frame, `left` and `right` are a (rectified) stereo frame."""

    def __post_init__(self) -> None:
        """Raises InputError for an image that is no array of uint8, grey or RGB."""
        for name, image in self.images.items():
            array = isinstance(image, np.ndarray)
            grey = array and image.ndim == 2
            if not array or image.dtype != np.uint8 or not (grey or (image.ndim == 3 and image.shape[2] == 3)):
                found = f"an array of {image.dtype} {image.shape}" if array else f"a {type(image).__name__}"
                raise InputError(
                    f"the {str(name)[:30]} image at {self.time_ns} ns is {found}: give uint8, 0 to 255, of the shape "
                    "(height, width) or, in RGB, (height, width, 3)"
                )

    @property
    def kind(self) -> Kind:
        """`video`, `stereo`, or `cameras` for any other set of cameras."""
        names = self.images.keys()
        return VIDEO if names == {"video"} else STEREO if names == {"left", "right"} else CAMERAS

    @property
    def image(self) -> Image:
        """The image of the video camera. Raises InputError where there is none; so do `left` and `right`."""
        return self._of("video")

    @property
    def left(self) -> Image:
        return self._of("left")

    @property
    def right(self) -> Image:
        return self._of("right")

    def _of(self, name: str) -> Image:
        if name not in self.images:
            raise InputError(f"this {self.kind} frame has no {name} image: it has {', '.join(self.images) or 'none'}")
        return self.images[name]

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name} {image.shape[1]}x{image.shape[0]}" for name, image in self.images.items())
        return f"Frame({self.kind} at {self.time_ns * 1e-9:.3f} s: {sizes})"

    @staticmethod
    def video(time_ns: int, image: Image) -> Frame:
        """Returns a video frame."""
        return Frame(time_ns, {"video": image})

    @staticmethod
    def stereo(time_ns: int, left: Image, right: Image) -> Frame:
        """Returns a stereo frame."""
        return Frame(time_ns, {"left": left, "right": right})

    def with_images(self, **images: Image) -> Frame:
        """Returns the frame with other images of these cameras."""
        return replace(self, images={**self.images, **images})


def is_video(measurement: Measurement) -> TypeGuard[Frame]:
    """Checks for a video frame."""
    return measurement.kind == VIDEO


def is_stereo(measurement: Measurement) -> TypeGuard[Frame]:
    """Checks for a stereo frame."""
    return measurement.kind == STEREO


def images_of(measurement: Measurement) -> Mapping[str, Image]:
    """Returns the images by camera name; empty for other measurements."""
    return measurement.images if isinstance(measurement, Frame) else {}


def main_image(measurement: Measurement) -> tuple[str, Image] | None:
    """Returns the name and image of the camera that is tracked, which is the left one of a stereo frame; None for other
    measurements than stereo and video frames."""
    name = {STEREO: "left", VIDEO: "video"}.get(measurement.kind)
    return None if name is None else (name, images_of(measurement)[name])


@dataclass(frozen=True, eq=False)
class ImuSamples(Measurement):
    """Consecutive samples of an inertial measurement unit. `time_ns` is the time of the last one."""

    times_ns: NDArray[np.int64]
    """(N,) strictly increasing [ns]."""
    angular_velocity_rad_s: Array
    """(N, 3) about the axes of the IMU's frame."""
    specific_force_m_s2: Array
    """(N, 3) along the axes of the IMU's frame: at rest it points up, with the length of gravity."""
    sensor: str = "imu"
    """Name of the IMU in the rig."""

    def __post_init__(self) -> None:
        """Raises ValueError where shapes differ, values are not finite, or times do not increase up to `time_ns`."""
        count = len(self.times_ns)
        _require_shape(self.angular_velocity_rad_s, (count, 3), "angular velocities")
        _require_shape(self.specific_force_m_s2, (count, 3), "specific forces")
        if not count or (np.diff(self.times_ns) <= 0).any() or self.times_ns[-1] != self.time_ns:
            raise ValueError("times of IMU samples must increase, and the last one is the time of the measurement")

    @property
    def kind(self) -> Kind:
        return "imu"


@dataclass(frozen=True, eq=False)
class GnssFix(Measurement):
    """The position of a GNSS antenna."""

    xyz_in_local: Array
    """(3,) [m] east, north and up of the origin of the sequence's local frame."""
    covariance: Array
    """(3, 3) [m^2] of that position."""
    sensor: str = "gnss"
    """Name of the antenna in the rig."""

    def __post_init__(self) -> None:
        """Raises ValueError where shapes are wrong, or values are not finite, or the covariance is not positive."""
        _require_shape(self.xyz_in_local, (3,), "position")
        _require_shape(self.covariance, (3, 3), "covariance")
        if not np.allclose(self.covariance, self.covariance.T) or np.linalg.eigvalsh(self.covariance)[0] <= 0:
            raise ValueError("the covariance of a GNSS fix must be symmetric and positive definite")

    @property
    def kind(self) -> Kind:
        return "gnss"


@dataclass(frozen=True, eq=False)
class WheelIncrement(Measurement):
    """The way that wheels rolled since an earlier time."""

    since_ns: int
    """When the increment begins [ns]."""
    distance_m: float
    """Along the x axis of the odometer's frame, forward; negative in reverse."""
    turned_rad: float | None = None
    """Rotation about the z axis of the odometer's frame, from a pair of wheels; None where one wheel is measured."""
    sensor: str = "wheel"
    """Name of the odometer in the rig."""

    def __post_init__(self) -> None:
        """Raises ValueError where a value is not finite, or the increment does not begin before it ends."""
        if not np.isfinite([self.distance_m, self.turned_rad or 0.0]).all():
            raise ValueError("distance and rotation of a wheel increment must be finite")
        if self.since_ns >= self.time_ns:
            raise ValueError("a wheel increment must begin before it ends")

    @property
    def kind(self) -> Kind:
        return "wheel"


@dataclass(frozen=True, eq=False)
class TimedPoints:
    """Points in the frame of a laser scanner or profiler, each at its own time."""

    times_ns: NDArray[np.int64]
    """(N,) on the clock of the frames, in any order [ns]."""
    xyz_in_laser: Array
    """(N, 3) [m]."""

    def __post_init__(self) -> None:
        if self.xyz_in_laser.shape != (len(self.times_ns), 3):
            raise ValueError(f"{len(self.times_ns)} times with points {self.xyz_in_laser.shape}")

    def __len__(self) -> int:
        return len(self.times_ns)

    def select(self, index: NDArray) -> TimedPoints:
        """Returns the points of a boolean mask or index array."""
        return TimedPoints(self.times_ns[index], self.xyz_in_laser[index])


@dataclass(frozen=True, eq=False)
class LaserScan(Measurement):
    """One scan of a laser scanner, whose points have times of their own (the platform moves meanwhile)."""

    points: TimedPoints = field(default_factory=lambda: TimedPoints(np.zeros(0, np.int64), np.zeros((0, 3))))
    sensor: str = "laser"
    """Name of the scanner in the rig."""

    def __post_init__(self) -> None:
        """Raises ValueError where a point is not finite, or later than the scan."""
        _require_shape(self.points.xyz_in_laser, (len(self.points), 3), "points")
        if (self.points.times_ns > self.time_ns).any():
            raise ValueError("the points of a laser scan must not be later than the scan")

    @property
    def kind(self) -> Kind:
        return "laser"


def as_grey(image: Image) -> Image:
    """Returns the image (H, W) of an RGB or grey one."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def colours_at(image: Image, uv: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Returns RGB (N, 3) of the pixels nearest to `uv` (N, 2); positions outside give the nearest pixel inside."""
    column = np.clip(np.rint(uv[:, 0]).astype(int), 0, image.shape[1] - 1)
    row = np.clip(np.rint(uv[:, 1]).astype(int), 0, image.shape[0] - 1)
    colours = image[row, column]
    return np.repeat(colours[:, None], 3, axis=1) if image.ndim == 2 else colours


def _require_shape(values: Array, shape: tuple[int, ...], what: str) -> None:
    if np.shape(values) != shape or not np.isfinite(values).all():
        raise ValueError(f"{what} must be finite, of shape {shape}; they have {np.shape(values)}")
