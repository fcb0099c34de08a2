"""The options of `ispom calibrate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ispom.calibration.models import Choice
from ispom.io.calibrations.files import AnyFormat


@dataclass(frozen=True, kw_only=True)
class Calibrate:
    """Calibrates cameras from images of a target: exit code 0 where the result is usable, 1 where it must be filmed
    again (the reasons are printed), 2 after a mistake. `rig FOLDER --from-motion` needs no target. `target` makes one
    to print: a PDF or SVG page of true size."""

    what: tyro.conf.Positional[Literal["video", "stereo", "rig", "convert", "target"]]
    """One camera; a stereo pair; the video camera and the pair on their rig; convert a calibration file; or make a
    target to print."""
    images: tyro.conf.Positional[tuple[Path, ...]]
    """A folder of images or a video file for each camera (video, left, right, in this order), or one folder that holds
    folders video, left and right (or cam0 and cam1), or images whose names begin with left and right. To convert: the
    file (its format is recognised), or a file for each camera. To print a target: its specification, as of
    --target. Or sim:calibration?views=30&seed=1&alike&blur_ms=20: rendered views of the target, whose truth is
    printed; or camera:0, to film now: it says what to show next, until nothing is missing or Ctrl-C is pressed."""
    target: str | None = None
    """What was filmed, in metres: chessboard:9x6:0.0242 (inner corners), aprilgrid:6x6:0.088:0.3,
    charuco:8x5:0.03:0.022, apriltag:4x3:0.05:0.01, aruco:5x7:0.04:0.01, circles:7x5:0.03, acircles:4x11:0.02."""
    from_motion: bool = False
    """Without a target. Of a video: focal length, principal point, k1 and k2 from the tracks of corners. Of a rig:
    place and clock of the video camera from how the cameras move in one recording of all three (a folder with
    sequence.yaml); interiors and pair must be calibrated."""
    out: Path | None = None
    """Write the calibration here, such as rig.yaml; where it must be filmed again, nothing is written. Of a target: a
    file whose name ends in .pdf or .svg; without it, target.pdf."""
    format: AnyFormat = "rig"
    """Of --out: ISPOM's rig.yaml or camera.yaml, Kalibr's camchain, EuRoC's sensor.yaml (a folder for several cameras),
    OpenCV's YAML, ROS's camera_info (a folder likewise), or COLMAP's cameras.txt."""
    image_size: str | None = None
    """Of `convert`: the size of the images, as 640x480, for a file that has none, or that is for several sizes."""
    model: Choice = "auto"
    """Camera model: the simplest that does well on views that it was not fitted to, or the one given."""
    joint: bool = True
    """Adjust the cameras' interiors together with their places; else by their own views alone."""
    max_views: int = 120
    """Most images that are used of each camera; they are chosen by sharpness and novelty."""
    clock_within: float = 5.0
    """Largest clock offset [s] that is looked for, of a rig whose video has times of its own (films, or times.txt)."""
    report: Path | None = None
    """Write a page with all detections, residuals and maps to this HTML file."""
    json: Path | None = None
    """Write all numbers as JSON to this file."""
