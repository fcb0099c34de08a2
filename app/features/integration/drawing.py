"""What a stage of an integration (Fig. 7) looks like: lines, dots and axes, as values and in the 3-D view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import rerun as rr

from ispom.geometry import Array
from ispom.solvers.trajectory.stages import Stage, stages
from ispom.types import SegmentFit, SplineFit, Step, Trajectory

from ...presentation import colours
from ...presentation.colours import Rgb
from ...views.rerun import entities
from ...views.rerun.batch import Entry
from ...views.rerun.eye import extent

VIDEO, STEREO = colours.METHOD["monocular"], colours.METHOD["stereo"]
"""Colours of each camera's results."""
BRACKET: Rgb = (230, 159, 0)
MISSING: Rgb = (198, 40, 40)
"""Colour of the line from the segment's end to its true position."""


@dataclass(frozen=True, eq=False)
class Line:
    name: str
    xyz: Array
    """(K, 3)."""
    colour: Rgb
    width_px: float = 2.5


@dataclass(frozen=True, eq=False)
class Dots:
    name: str
    xyz: Array
    """(K, 3)."""
    colour: Rgb
    size: float = 1.0
    """Relative to a usual one."""


@dataclass(frozen=True, eq=False)
class Axes:
    name: str
    poses: Trajectory


Shape = Line | Dots | Axes


def drawing(step: Step, stage: int) -> tuple[Shape, ...]:
    """Of a step's last segment, or of its spline; in the shared world. Empty where the history gave it up."""
    if step.segments:
        fit, found = step.segments[-1], stages(step.segments[-1])
        return _segment(fit, found[min(stage, len(found) - 1)], colours.of(step.method)) if found else ()
    if step.spline is not None and len(step.spline.times_ns):
        return _spline(step.spline, stage, colours.of(step.method))
    return ()


def _segment(fit: SegmentFit, stage: Stage, colour: Rgb) -> tuple[Shape, ...]:
    metric, poses = fit.metric_ends, stage.poses
    done = stage.kind == "oriented"
    found: list[Shape] = [
        Line("stereo", metric.translations, STEREO),
        Dots("stereo_poses", metric.translations, STEREO, 1.6),
        Axes("stereo_axes", metric),
        Line("video", poses.translations, colour if done else VIDEO),
        Dots("video_poses", poses.translations, colour if done else VIDEO, 0.8),
        Axes("video_axes", poses),
    ]
    if stage.kind != "given":
        found.append(Dots("ends", stage.ends.translations, BRACKET, 1.4))
    if stage.kind == "bracketed":
        found.append(Dots("bracket", poses.translations[bracket_rows(fit)], BRACKET))
    if stage.gap_m > 0:
        found.append(Line("gap", np.stack([stage.ends.translations[1], metric.translations[1]]), MISSING, 2.0))
    return tuple(found)


def bracket_rows(fit: SegmentFit) -> list[int]:
    """Which of the fit's video poses are just before and just after each of its two ends."""
    after = [int(np.searchsorted(fit.video.times_ns, t)) for t in fit.span_ns]
    rows = {min(max(row, 0), len(fit.video) - 1) for i in after for row in (i - 1, i)}
    return sorted(rows)


def _spline(fit: SplineFit, stage: int, colour: Rgb) -> tuple[Shape, ...]:
    where = fit.before if stage < 2 else fit.after
    found: list[Shape] = [
        Dots("video_exposures", where[fit.video], VIDEO, 0.8),
        Dots("pairs", where[~fit.video], STEREO, 1.6),
    ]
    if stage == 1:
        found += [Line("spline", fit.before, colour), Dots("knots", fit.knots_before, BRACKET)]
    if stage > 1:
        found += [Line("begun", fit.before, colours.TRUTH, 1.2), Line("spline", fit.after, colour)]
        found.append(Dots("knots", fit.knots_after, BRACKET))
    return tuple(found)


def positions(shapes: tuple[Shape, ...]) -> Array:
    """(N, 3) of all that is drawn."""
    xyz = [shape.poses.translations if isinstance(shape, Axes) else shape.xyz for shape in shapes]
    return np.concatenate([np.zeros((0, 3)), *xyz])


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
