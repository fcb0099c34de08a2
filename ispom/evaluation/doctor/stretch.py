"""The stretch of a recording that is examined: its images at a moderate size, its times, and its calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.types import Image, Rig


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame of the stretch."""

    index: int
    """Index of the frame in the sequence."""
    time_ns: int
    images: dict[str, Image]
    """By camera: grey, at the size of `Examination.rig`."""

    @property
    def is_pair(self) -> bool:
        return "left" in self.images


@dataclass(frozen=True, eq=False)
class Stretch:
    """Frames of a sequence, in the order of time."""

    rig: Rig
    """The rig, with cameras of the size of the images."""
    shots: tuple[Shot, ...]
    times_ns: NDArray[np.int64]
    """Times of all frames of the main camera's kind in the stretch and before it, from which the usual interval, and so
    a gap, is known."""
    reduced: Mapping[str, int] = field(default_factory=dict)
    """By camera: pixels of the recording per pixel of the images here; 1 for cameras that are not listed."""

    def recorded_px(self, camera: str, examined_px: float) -> float:
        """Returns a length in pixels of the recording's images, of one in pixels of the images here."""
        return self.reduced.get(camera, 1) * examined_px

    @property
    def main(self) -> str:
        """The camera in whose images corners are tracked: the video camera, else the left one of the pair."""
        return "video" if self.rig.video is not None else "left"

    @cached_property
    def main_shots(self) -> tuple[Shot, ...]:
        """Frames of the main camera."""
        return tuple(shot for shot in self.shots if self.main in shot.images)

    @cached_property
    def pairs(self) -> tuple[Shot, ...]:
        """Frames of the stereo pair."""
        return tuple(shot for shot in self.shots if shot.is_pair)
