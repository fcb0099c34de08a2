"""What a rectified recording of one or two cameras offers, before it is decided which image plays which camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.sequences.recorded_sensors import RecordedSensor
from ispom.types import Camera, Found, Guess, Image, LensSigma, PairSigma, Trajectory

Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class Recording:
    """Rectified images of a left and perhaps a right camera, exposed together."""

    name: str
    """What a person recognises: "KITTI 06"."""
    camera: Camera
    """Of both sides."""
    baseline_m: float | None
    """None where there is no right camera."""
    times_ns: NDArray[np.int64]
    """(N,) increasing."""
    read: Callable[[Side, int], Image]
    """Reads image i of a side; InputError where its file is unreadable or of the wrong size."""
    truth: Trajectory | None = None
    """world_from_left."""
    notes: tuple[str, ...] = ()
    """What a person must know about it: images without a partner, a gap in time."""
    left_from_laser: Pose | None = None
    """Of another sensor, where one is known."""
    video_sigma: LensSigma | None = None
    """How sure the calibration is of the camera by itself,"""
    pair_sigma: PairSigma | None = None
    """and of the pair; None where it does not say."""
    guess: Guess | None = None
    """Where the camera has no calibration; its note comes before the others."""
    found: tuple[Found, ...] = ()
    """What lies in or beside it, but for the sensors: used or not."""
    sensors: tuple[RecordedSensor, ...] = ()
    """The other sensors that lie in or beside it, with their poses in the left camera."""
