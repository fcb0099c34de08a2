"""Options of `ispom evaluate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ispom.evaluation.trajectory_error import Alignment


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Compares trajectories with a reference: ATE, RPE, KITTI's errors, scale and coverage, with their protocol."""

    reference: tyro.conf.Positional[Path]
    """Reference trajectory: a file of poses of any known program (TUM, KITTI, EuRoC, COLMAP, nerfstudio, OpenVINS,
    g2o, tables with a header, JSON, bags as BAG:TOPIC ...), recognised by its content."""
    estimates: tyro.conf.Positional[tuple[Path, ...]]
    """Trajectories to compare with it."""
    alignment: Alignment = "se3"
    """How an estimate is aligned with the reference. none; first: at the first pose; scale: scale only; se3: rotation
    and translation; sim3: those and scale (needed where the estimate's unit is not the metre)."""
    max_difference_s: float = 0.01
    """Largest time difference of associated poses [s]."""
    times: Path | None = None
    """Times of the rows of files without times, such as KITTI's and COLMAP's [s], as KITTI's times.txt."""
    delta: int = 1
    """Distance of the two poses of a relative error (RPE) [poses]."""
    json: Path | None = None
    """Write all numbers and the protocol as JSON to this file."""
    csv: Path | None = None
    """Write a line per estimate to this file."""
    plots: Path | None = None
    """Write plots of trajectories, errors and scale to this folder."""
    plot_format: Literal["png", "svg"] = "png"
    """Format of the plots."""
