"""Options of `ispom export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ...engine.options import Name, Programs


@dataclass(frozen=True, kw_only=True)
class Export(Programs):
    """Converts a run for other tools: trajectories, point clouds, COLMAP models."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    format: Literal["tum", "kitti", "euroc", "vslam-lab", "ply", "colmap", "csv", "panorama"]
    """tum, kitti, euroc, vslam-lab: trajectories (the last of the left or only camera); ply: cloud, trajectory, and the
    map of lines or tags; colmap: keyframes, points and observations, as a text model; csv: poses, points and lines with
    a header; panorama: the images by their orientations, as a PNG."""
    methods: tuple[Name, ...] = ()
    """Methods to export; none given means all of the run."""
    out: Path | None = None
    """Folder to write to; without it, export/FORMAT in the run's."""
    max_error_px: float = 3.0
    """COLMAP: largest reprojection error of an observation that a model keeps [px]."""
