"""Options of `ispom run` and `ispom fork`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from ...engine.options import MovedSource, Name, Options, Programs, Settings


@dataclass(frozen=True, kw_only=True)
class Run(Options):
    """Runs the methods over a source without a window, and writes trajectories, metrics and a recording."""

    source: tyro.conf.Positional[str]
    """sim:NAME, the folder of a drive (KITTI, EuRoC, TUM) or of images, a video, a bag, a sequence.yaml, or a live
    camera: camera:0, http://..., rtsp://..."""
    out: Path | None = None
    """Folder to write to; without it, a new one below recordings/."""
    frame: Literal["rig", "left", "video"] = "rig"
    """The frame whose poses are written."""
    recording: bool = True
    """Write run.rrd, which any Rerun viewer opens."""
    until: str | None = None
    """Stop after the first frame where this condition holds, such as 'integrated.error_m > 0.2' or
    'monocular.inliers < 30 and stereo.status == "lost"'. docs/reference/conditions.md lists the names."""


@dataclass(frozen=True, kw_only=True)
class Fork(Programs, MovedSource):
    """Repeats a run up to a frame, and goes on from there with other settings or methods."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` or `ispom fork` wrote."""
    at: int
    """First frame with the given settings, counted from 0 as in the page and in steps.csv."""
    methods: tuple[Name, ...] = ()
    """Methods from there on; default: those of the run. A method that did not run before starts there."""
    out: Path | None = None
    """Folder to write to; without it, a new one below recordings/."""
    recording: bool = True
    """Write run.rrd, which any Rerun viewer opens."""
    settings: Annotated[Settings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Settings)
    """Settings that are not given stay as they were in the run."""
