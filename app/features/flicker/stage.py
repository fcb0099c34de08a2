"""The two sides of a flicker on the stage. Both are drawn; the layout hides one, so that a key shows the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from ispom.geometry import Similarity

from ...engine.model.drawn_size import drawn_size
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...views.rerun import entities
from ...views.rerun.batch import Entry
from .flicker import Side

PATH_PX, POINT_PX, CAMERA_PX = 1.0, 1.25, 1.0
"""Half widths on the screen."""


def side(name: str, shown: Side, run: CurrentRun, index: int) -> Iterator[Entry]:
    """Path, points and camera of a side, `name` a or b, as known at a frame or its run's last one before."""
    last = run.history.last
    if last is None:
        return
    index = min(index, last.index)
    known = run.known_at(index).methods[shown.method]
    placement = run.history[index].placements.get(shown.method, Similarity())
    root, colour, poses = f"world/flicker/{name}", colours.of(shown.method), known.poses
    lines = [placement.apply(line) for block in sorted(poses.drawn_blocks()) for line in poses.lines(block)]
    if lines:
        yield Entry(f"{root}/path", entities.lines(lines, colour, PATH_PX))
    if known.points.blocks:
        xyz, rgb = (np.concatenate([getattr(b, kind) for b in known.points.blocks]) for kind in ("xyz", "rgb"))
        yield Entry(f"{root}/cloud", rr.Points3D(placement.apply(xyz), colors=rgb, radii=[-POINT_PX]))
    row, rig = poses.last_known(), run.opened.sequence.rig
    camera = "video" if rig.video is not None else "left"
    if row is not None and (rig.video or rig.left) is not None:
        size = drawn_size(shown.method, rig, run.opened.truth, poses, placement.scale, None).camera
        frame_from_camera = rig.rig_from(poses.frame).inverse() @ rig.rig_from(camera)
        outline = poses.pose(row).apply(entities.frustum(rig.camera(camera), frame_from_camera, size))
        yield Entry(f"{root}/camera", entities.lines([placement.apply(outline)], colour, CAMERA_PX))
