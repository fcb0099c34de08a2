"""What a calibration found, as one frozen value: everything that a page, a report or a program may ask about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.solve import Solution
from ispom.calibration.detection import Detection
from ispom.calibration.diagnostics.coverage import Coverage
from ispom.calibration.diagnostics.maps import ImageMap
from ispom.calibration.diagnostics.parameters import Parameter
from ispom.calibration.models import Trial
from ispom.calibration.targets import Target
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig

Level = Literal["good", "usable", "redo"]


class Redo(Exception):
    """What was filmed does not suffice; the message is one sentence that says what to film."""


@dataclass(frozen=True, eq=False)
class Views:
    """What one camera saw."""

    name: str
    """video, left or right."""
    size: tuple[int, int]
    """(width, height) of its images."""
    images: tuple[str, ...]
    """Their names."""
    detections: tuple[Detection, ...]
    times_ns: NDArray[np.int64] | None = None
    """(N,) increasing, by the camera's own clock; None where they are not known."""

    def select(self, index: NDArray[np.int64]) -> Views:
        """Some of the images."""
        times_ns = None if self.times_ns is None else self.times_ns[index]
        images, detections = (tuple(values[i] for i in index) for values in (self.images, self.detections))
        return Views(self.name, self.size, images, detections, times_ns)


@dataclass(frozen=True)
class Rejected:
    """An image, or one point in it, that the calibration is not made of."""

    camera: str
    image: str
    point: int | None
    """Of the target; None for the whole image."""
    reason: str


@dataclass(frozen=True)
class Verdict:
    level: Level
    reasons: tuple[str, ...]
    """Why it is not better; empty where it is good."""
    advice: tuple[str, ...]
    """What to film next."""


@dataclass(frozen=True, eq=False)
class CameraResult:
    """One camera of the calibration."""

    views: Views
    camera: Camera
    trials: tuple[Trial, ...]
    """The models compared, and how they did on views that they were not fitted to."""
    uncertainty: ImageMap
    """Standard deviation of projections over the image."""
    halves: ImageMap
    """How differently two halves of the views, solved apart, project."""
    coverage: Coverage


@dataclass(frozen=True, eq=False)
class RowError:
    """Of the rectified pair: by how much the two pictures of a point miss each other's row."""

    uv_left: Array
    """(N, 2) [px] where, in the left image as filmed."""
    rows_px: Array
    """(N,) left minus right."""

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.rows_px**2).mean())) if len(self.rows_px) else float("nan")


@dataclass(frozen=True)
class Clock:
    """Of the video camera, against that of the stereo pair."""

    offset_s: float
    """The video's time stamps are to be increased by it: `offset_s` of its entry in sequence.yaml."""
    standard_error_s: float
    determined: bool
    """Whether the motion tells it."""


@dataclass(frozen=True)
class LineDelay:
    """Of a camera whose shutter rolls from the first row to the last."""

    seconds: float
    """From one row to the next; negative where the shutter rolls upwards."""
    standard_error_s: float
    height: int
    """Rows of the image."""

    @property
    def image_s(self) -> float:
        """From the first row to the last."""
        return self.seconds * (self.height - 1)

    @property
    def rolls(self) -> bool:
        """Whether it is significant: then the calibration's corners are corrected for it."""
        return abs(self.seconds) > 3 * self.standard_error_s


@dataclass(frozen=True, eq=False)
class Calibration:
    """Of one camera, a pair, or all three."""

    target: Target
    cameras: tuple[CameraResult, ...]
    solution: Solution
    """In its estimate the first camera is the rig."""
    image_of: NDArray[np.int64]
    """(V, C) of each view of the solution, which image of each camera it was; -1 for none."""
    rig: Rig
    """As it is written to a file."""
    parameters: tuple[Parameter, ...]
    correlations: Array
    """(G, G) of the parameters."""
    rejected: tuple[Rejected, ...]
    row_error: RowError | None
    halves_pose: Pose | None
    """How differently the two halves place the second camera: pose of the one after the inverse of the other."""
    clock: Clock | None
    """Where the video's images were taken at times of their own; None where all were taken at the same time."""
    line_delay: LineDelay | None
    """Of a single camera that was filmed in motion; None of others."""
    verdict: Verdict

    @property
    def undetermined(self) -> tuple[Parameter, ...]:
        return tuple(parameter for parameter in self.parameters if not parameter.determined)

    @property
    def baseline_m(self) -> float | None:
        """Distance of the two cameras of the pair; None without a pair."""
        return abs(self.rig.baseline_m) if self.rig.has_stereo else None
