"""An integration with a wrong calibration: the video's own path, carried onto the poses of the pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.solvers.trajectory.anchoring import anchored
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import Rig, Trajectory


def carried(run: Trajectory, pairs: Trajectory, rig: Rig, wrong: Perturbation) -> Trajectory:
    """world_from_rig at the video frames of a run, at the run's own stamps, as a wrong calibration would have it.

    `pairs` is world_from_rig at the stereo pairs, with the wrong calibration. The video sees the shape of its own path
    as before. A wrong place on the rig and a wrong clock change where that path is on the rig's; at the pairs it meets
    theirs, so that only what varies between two pairs is left.
    """
    told = wrong.of_rig(rig)
    late_ns = round(wrong.clock_ms * 1e6)
    own = run.moved(right=rig.rig_from_video @ told.rig_from_video.inverse())
    own = replace(own, times_ns=own.times_ns + late_ns)
    inside = pairs.times_ns[(pairs.times_ns >= own.times_ns[0]) & (pairs.times_ns <= own.times_ns[-1])]
    inside = np.setdiff1d(inside, own.times_ns)
    met = interpolate(own, inside, "linear")
    both = Trajectory.of([*own.items(), *met.items()], run.frame)
    found = anchored(both, pairs)
    found = found.select(np.isin(found.times_ns, own.times_ns))
    return replace(found, times_ns=found.times_ns - late_ns)
