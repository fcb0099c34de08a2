"""The options of `ispom map`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from ispom.solvers.trajectory.continuous import Between

from ...engine.options import MovedSource, ReadsRuns

From = Literal["stereo", "video", "both"]
SIMULATED = "sim"
"""Name in place of a file, for the profiler of a simulation."""


@dataclass(frozen=True, kw_only=True)
class Map(ReadsRuns, MovedSource):
    """Makes a dense model of what a run saw: a coloured mesh and a cloud from its stereo pairs, or from one camera's
    video. With --laser, places a laser's points by each method's poses."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    method: str | None = None
    """Whose poses the model takes; default: integrated, or else stereo, or else monocular. The model of a method with a
    unit of its own is in that unit."""
    segment: int | None = None
    """Number of the segment of a method with a unit of its own, from 1, as in METHOD.N.tum: segments share no unit.
    Default: the one with the most poses."""
    laser: str | None = None
    """A CSV or PLY file of points with a time each, of the laser that the run's rig.yaml places (rig_from_laser); or
    sim, the profiler of a simulation. Its points are placed by all metric methods of the run."""
    interpolate: Between = "spline"
    """Poses between poses, at each point's time."""
    dense: bool = True
    """Make the mesh and the cloud."""
    depth_from: From | None = None
    """Whose images give the depth: stereo pairs, or the video's, by the motion between them (plane sweep), or both.
    Default: stereo pairs where the method is metric and there are some, or else the video."""
    voxel_m: float | None = None
    """Size of a voxel [m, or the method's own unit]; default: a tenth of the baseline. Without a pair, an
    eightieth of the near depth, which is that of the method's points at their tenth percentile."""
    max_depth_m: float | None = None
    """Depth beyond which a pair is too inaccurate [m, or the method's own unit]; default: 25 baselines.
    Without a pair, a quarter of the near depth stands for the baseline."""
    memory_gb: float = 4.0
    """Most that voxels may take [GB]."""
    out: Path | None = None
    """Folder to write to; without it, map in the run's."""
