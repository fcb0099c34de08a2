"""A rectified recording of one or two cameras, before its images are assigned to video and stereo frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Pose
from ispom.sequences.own_sensors import OwnSensor
from ispom.types import Camera, Found, Guess, Image, LensSigma, PairSigma, Trajectory

Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class Recording:
    """Rectified images of a left camera and, optionally, a right one, exposed together."""

    name: str
    """Name for people: "KITTI 06"."""
    camera: Camera
    """The camera of both sides."""
    baseline_m: float | None
    """None where there is no right camera."""
    times_ns: NDArray[np.int64]
    """(N,) increasing."""
    read: Callable[[Side, int], Image]
    """Reads image i of a side; InputError where its file is unreadable or of the wrong size."""
    truth: Trajectory | None = None
    """world_from_left."""
    notes: tuple[str, ...] = ()
    """Sentences for the user, as about images without a partner, or a gap in time."""
    left_from_laser: Pose | None = None
    """Pose of a laser scanner; None without one."""
    video_sigma: LensSigma | None = None
    """Standard deviations of the camera's calibration; None where they are not stated."""
    pair_sigma: PairSigma | None = None
    """Standard deviations of the pair's calibration; None where they are not stated."""
    guess: Guess | None = None
    """The guessed focal length of a camera without a calibration; its note comes before the others."""
    found: tuple[Found, ...] = ()
    """Files in or beside the recording, except those of sensors, whether used or not."""
    sensors: tuple[OwnSensor, ...] = ()
    """Other sensors whose files are in or beside the recording, with their poses in the left camera."""
