"""A stage of an integration (Fig. 7) in the 3-D view."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from ispom.types import Step

from ...views.rerun import entities
from ...views.rerun.batch import Entry
from ...views.rerun.eye import extent
from .drawing import Axes, Dots, Line, Shape, drawing, positions

ROOT = "world/integration"
DOT_PX, AXIS_PX = 3.0, 0.75
"""Half widths on the screen."""
AXIS = 0.06
"""Length of an axis, relative to all that is drawn."""
AXIS_COLOURS = np.array([[230, 60, 60], [60, 180, 75], [70, 110, 230]], np.uint8)


def entries(step: Step, stage: int) -> Iterator[Entry]:
    shapes = drawing(step, stage)
    size = extent(positions(shapes))
    for shape in shapes:
        yield Entry(f"{ROOT}/{shape.name}", _value(shape, size))


def _value(shape: Shape, size: float) -> rr.AsComponents:
    match shape:
        case Line():
            return entities.lines([shape.xyz], shape.colour, shape.width_px / 2)
        case Dots():
            return rr.Points3D(shape.xyz, colors=shape.colour, radii=-DOT_PX * shape.size)
        case Axes():
            starts, rotations = shape.poses.translations, shape.poses.rotations
            ends = starts[:, None] + AXIS * size * rotations.transpose(0, 2, 1)
            strips = np.stack([np.repeat(starts, 3, axis=0), ends.reshape(-1, 3)], 1)
            return rr.LineStrips3D(strips, colors=np.tile(AXIS_COLOURS, (len(starts), 1)), radii=-AXIS_PX)
