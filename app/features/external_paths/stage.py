"""The trajectories of other programs over a recording that is over, which was made without them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...engine.model.drawn_size import drawn_truth, true_size
from ...session.current_run import CurrentRun
from ...views.rerun import entities
from ...views.rerun.batch import Entry
from ...views.rerun.external_trajectories import ExternalTrajectoryLog


def shows_recording(run: CurrentRun) -> bool:
    """Whether the stage shows what was recorded of the run, and not what is drawn of it now."""
    return run.stored is not None and run.stored.recording is not None


def paths_of_others(run: CurrentRun, index: int) -> Iterator[Entry]:
    """Up to a frame, with their poses there."""
    opened, record = run.opened, run.history[index]
    size = true_size(drawn_truth(opened.truth, opened.methods)) or 1.0
    rig = opened.sequence.rig
    has_camera = (rig.video or rig.left) is not None
    outlines = entities.outlines(rig, "rig", size, main_camera=True) if has_camera else np.zeros((0, 2, 3))
    yield from ExternalTrajectoryLog(opened).at(index, record.time_ns, run.known_at(index), record.placements, outlines)
