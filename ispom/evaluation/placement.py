"""Where a trajectory without metric scale is drawn beside the others."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose, Similarity
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Rig, Trajectory


def first_segment_placement(video: Trajectory, stereo: Trajectory, rig: Rig) -> Similarity | None:
    """stereo_world_from_video_world, fixed by the first stereo segment that the video poses span.

    `video` is world_from_video in its own unit, `stereo` world_from_rig in metres. The pose at the segment's start
    coincides, the distance to its end gives the scale; nothing later counts, so that drift shows. None while no
    segment is spanned, or where it has no length.
    """
    if len(video) < 2:
        return None
    inside = (stereo.times_ns >= video.times_ns[0]) & (stereo.times_ns <= video.times_ns[-1])
    ends = np.flatnonzero(inside)[:2]
    if len(ends) < 2:
        return None
    metric = stereo.select(ends).moved(right=rig.rig_from_video)
    own = interpolate(video, metric.times_ns, "bspline")
    metric_length, own_length = metric.length, own.length
    if own_length < 1e-9 or metric_length < 1e-9:
        return None
    scale = metric_length / own_length
    own_start = own.pose(0)
    moved = metric.pose(0) @ Pose(own_start.rotation, scale * own_start.translation).inverse()
    return Similarity(scale, moved)
