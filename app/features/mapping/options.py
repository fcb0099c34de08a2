"""The options of `ispom map`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ispom.solvers.trajectory.continuous import Between

From = Literal["stereo", "video", "both"]
SIMULATED = "sim"
"""In place of a file: the profiler of a simulation."""


@dataclass(frozen=True, kw_only=True)
class Map:
    """Makes a dense model of what a run saw: a coloured mesh and a cloud from its stereo pairs. With --laser, places a
    laser's points by each method's poses."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    method: str | None = None
    """Whose poses the model takes, metric ones; default: integrated, or else stereo."""
    laser: str | None = None
    """A CSV or PLY file of points with a time each, of the laser that the run's rig.yaml places (rig_from_laser); or
    sim, the profiler of a simulation. Its points are placed by all metric methods of the run."""
    interpolate: Between = "spline"
    """Poses between poses, at each point's time."""
    dense: bool = True
    """Make the mesh and the cloud."""
    depth_from: From = "stereo"
    """Whose images give the depth: stereo pairs, or the video's, by the motion between them (plane sweep), or both."""
    voxel_m: float | None = None
    """Size of a voxel [m]; default: a tenth of the baseline."""
    max_depth_m: float | None = None
    """Depth beyond which a pair is too inaccurate [m]; default: 25 baselines."""
    memory_gb: float = 4.0
    """Most that voxels may take [GB]."""
    source: str | None = None
    """Where the run's source is now, if it has been moved."""
    out: Path | None = None
    """Folder to write to; without it, map in the run's."""
