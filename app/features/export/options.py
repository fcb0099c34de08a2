"""Options of `ispom export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ...engine.options import Name, Programs, ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Export(Programs, ReadsRuns):
    """Converts a run for other tools: trajectories, point clouds, models of COLMAP and
    nerfstudio, MCAP, calibrations."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    format: Literal[
        "tum", "kitti", "euroc", "vslam-lab", "ply", "colmap", "colmap-binary", "nerfstudio", "mcap", "kalibr",
        "orbslam", "csv", "panorama",
    ]  # fmt: skip
    """tum, kitti, euroc, vslam-lab: trajectories (the last of the left or only camera); ply: cloud, trajectory, and the
    map of lines or tags; colmap: keyframes, points and observations, as a text or binary model; nerfstudio: keyframes
    and their images; mcap: poses, points and images of keyframes, for Foxglove and ROS 2; kalibr, orbslam: the cameras
    of the run, for Kalibr and OpenVINS, or ORB-SLAM3; csv: poses, points and lines with a header; panorama: the images
    by their orientations, as a PNG."""
    methods: tuple[Name, ...] = ()
    """Methods to export; none given means all of the run."""
    out: Path | None = None
    """Folder to write to; without it, export/FORMAT in the run's."""
    max_error_px: float = 3.0
    """COLMAP: largest reprojection error of an observation that a model keeps [px]."""
