"""The result of a calibration as one frozen value, and its verdict: good, usable or redo, with reasons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.solve import Solution
from ispom.calibration.detection.detection import Detection
from ispom.calibration.diagnostics import Coverage, ImageMap, Parameter
from ispom.calibration.models import Trial
from ispom.calibration.targets.target import Target
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig

Level = Literal["good", "usable", "redo"]


class Redo(Exception):
    """The images do not suffice; the message is one sentence that explains what to film."""


@dataclass(frozen=True, eq=False)
class Views:
    """The images and detections of one camera."""

    name: str
    """video, left or right."""
    size: tuple[int, int]
    """(width, height) of its images."""
    images: tuple[str, ...]
    """Their names."""
    detections: tuple[Detection, ...]
    times_ns: NDArray[np.int64] | None = None
    """(N,) increasing, by the camera's own clock; None where they are not known."""

    @property
    def known_times_ns(self) -> NDArray[np.int64]:
        """The times (N,). Raises ValueError where they are not known."""
        if self.times_ns is None:
            raise ValueError(f"the images of {self.name} have no times")
        return self.times_ns

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
    """Index in the target; None for the whole image."""
    reason: str


@dataclass(frozen=True)
class Verdict:
    """Whether a calibration can be used, and why."""

    level: Level
    reasons: tuple[str, ...]
    """Why it is not better; empty where it is good."""
    advice: tuple[str, ...]
    """Advice on what to film next."""


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
    """Difference of the projections of two halves of the views, solved separately."""
    coverage: Coverage


@dataclass(frozen=True, eq=False)
class RowError:
    """Distance of matching points from each other's row in the rectified pair."""

    uv_left: Array
    """(N, 2) [px] positions in the left image as filmed."""
    rows_px: Array
    """(N,) left minus right."""

    @property
    def rms_px(self) -> float:
        return float(np.sqrt((self.rows_px**2).mean())) if len(self.rows_px) else float("nan")


@dataclass(frozen=True)
class Clock:
    """Clock offset of the video camera from the stereo pair."""

    offset_s: float
    """The video's time stamps are to be increased by it: `offset_s` of its entry in sequence.yaml."""
    standard_error_s: float
    determined: bool
    """The motion determines it."""


@dataclass(frozen=True)
class LineDelay:
    """Line delay of a camera with a rolling shutter."""

    seconds: float
    """Delay from one row to the next; negative where the shutter rolls upwards."""
    standard_error_s: float
    height: int
    """Rows of the image."""

    @property
    def image_s(self) -> float:
        """Time from the first row to the last."""
        return self.seconds * (self.height - 1)

    @property
    def rolls(self) -> bool:
        """The delay is significant: the calibration's corners are corrected for it."""
        return abs(self.seconds) > 3 * self.standard_error_s


@dataclass(frozen=True, eq=False)
class Calibration:
    """The calibration of one camera, a pair, or all three."""

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
    """Difference of the second camera's poses by the two halves: one times the inverse of the other."""
    clock: Clock | None
    """None where all images were taken at the same time."""
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


GOOD_RMS, USABLE_RMS = 1 / 1000, 1 / 250
"""Reprojection errors (root mean square) as shares of the image's width."""
GOOD_UNCERTAINTY, USABLE_UNCERTAINTY = 1 / 1000, 1 / 200
"""Uncertainty of projections, at the 90th percentile over the image, as a share of its width."""
GOOD_HALVES, USABLE_HALVES = 1 / 500, 1 / 100
"""Difference of two halves of the views, the same way. Each half is uncertain by sqrt(2) times as much as all views,
so they should differ by twice the uncertainty. Larger differences mean images that are not of one unchanged
camera: some are rotated, mirrored, zoomed or refocused."""
COVERED = 0.6
"""Least share of the image with enough views."""
MOSTLY = 0.5
"""Least share of the images that must be used."""
GOOD_ROWS_PX = 0.5
FEW_VIEWS = 8


def verdict(
    solution: Solution,
    cameras: tuple[CameraResult, ...],
    parameters: tuple[Parameter, ...],
    rows: RowError | None,
    used: dict[str, int],
    clock: Clock | None = None,
) -> Verdict:
    """Judges a calibration; `used` is the number of used images of each camera."""
    redo = _undetermined(parameters)
    minor: list[str] = []
    for c, each in enumerate(cameras):
        name, width = each.views.name, each.camera.width
        own = solution.residuals_px[solution.seen.camera == c]
        rms = float(np.sqrt((own**2).sum(1).mean())) if len(own) else np.inf
        _judge(redo, minor, rms / width, GOOD_RMS, USABLE_RMS, f"{name}: reprojection error {rms:.2f} px")
        if not redo:
            spread = _ninth(each.uncertainty.px)
            said = f"{name}: projections are uncertain by {spread:.2f} px"
            _judge(redo, minor, spread / width, GOOD_UNCERTAINTY, USABLE_UNCERTAINTY, said)
        apart = _ninth(each.halves.px)
        said = f"{name}: two halves of the views differ by {apart:.2f} px"
        if apart > USABLE_HALVES * width:
            said += ": some images are turned, zoomed or focused otherwise, or there are too few"
        _judge(redo, minor, apart / width, GOOD_HALVES, USABLE_HALVES, said)
        covered = each.coverage.covered
        if covered < COVERED:
            minor.append(f"{name}: the board was seen in {100 * covered:.0f} % of the image only")
        count = len(each.views.images)
        if used[name] < MOSTLY * sum(not d.reason for d in each.views.detections):
            redo.append(f"{name}: {used[name]} of {count} images fit together only")
        if used[name] < FEW_VIEWS:
            minor.append(f"{name}: {used[name]} views only")
    if rows is not None and rows.rms_px > GOOD_ROWS_PX:
        minor.append(f"rows of the rectified pair differ by {rows.rms_px:.2f} px")
    if clock is not None and not clock.determined:
        minor.append("video: the clock offset is not determined: move the cameras while they film")
    advice = tuple(dict.fromkeys(f"{each.views.name}: {text}" for each in cameras for text in each.coverage.advice))
    if redo:
        return Verdict("redo", tuple(redo), advice)
    return Verdict("usable" if minor else "good", tuple(minor), advice)


def _undetermined(parameters: tuple[Parameter, ...]) -> list[str]:
    """One reason for each camera that has such parameters."""
    lost: dict[str, list[str]] = {}
    for parameter in parameters:
        if not parameter.determined:
            lost.setdefault(parameter.camera, []).append(parameter.name)
    return [
        f"{name}: the views are too much alike to determine {', '.join(those)}: tilt the board and vary its distance"
        for name, those in lost.items()
    ]


def _judge(redo: list[str], minor: list[str], value: float, good: float, usable: float, said: str) -> None:
    if not value <= usable:
        redo.append(said)
    elif value > good:
        minor.append(said)


def _ninth(px: Array) -> float:
    """Returns the 90th percentile: the outermost corners are beyond any use."""
    return float(np.percentile(px, 90))
