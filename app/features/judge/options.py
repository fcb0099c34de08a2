"""Options of `ispom judge`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ...engine.options import SourceOptions

FrameOfPoses = Literal["auto", "camera", "rig"]


@dataclass(frozen=True, kw_only=True)
class Judge(SourceOptions):
    """Judges poses of any program by the images of their recording, without ground truth: clock, axes, mount, lever
    arm, drift, smoothing, jumps, steps of the scale, and rest. The exit code is 0 where the images agree, 1 where they
    contradict the poses, 2 for a mistake in what you gave, and 3 where they cannot tell."""

    poses: tyro.conf.Positional[Path]
    """File of poses of any known program, as for `ispom evaluate`. It may cover a part of the recording."""
    recording: tyro.conf.Positional[str]
    """The recording: any source that `ispom run` takes, with a calibration."""
    frame: FrameOfPoses = "auto"
    """Whose poses the file has: those of the main camera (video, else left), or of the rig. auto: the rig's for EuRoC's
    files and those that `ispom run` wrote so, else the camera's."""
    times: Path | None = None
    """Times of the rows of a file without times [s], as KITTI's times.txt. Default: row N is frame N."""
    json: bool = False
    """Print the judgement as JSON."""
    out: Path | None = None
    """Folder for judge.json."""
    page: Path | None = None
    """HTML file with a plot of the misfit over time. It needs no network."""
