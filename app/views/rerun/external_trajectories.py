"""The trajectories of other programs in a recording: /world/beside/NAME and /plots/error/beside/NAME.

They are synchronised with the frames: at a frame, the path up to its time and the interpolated pose are drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from ispom.geometry import Array, Similarity

from ...engine.events import Opened
from ...engine.external_trajectories.placed import ExternalTrajectory, Placed
from ...engine.external_trajectories.places import Places
from ...engine.model.run_model import RunModel
from ...presentation import colours
from . import entities
from .batch import Entry

POSES_PER_LINE = 100
"""Number of poses of one line: a new pose logs only its line again."""
WIDTH_PX = 1.2


class ExternalTrajectoryLog:
    """Draws the trajectories during one run, or at one frame of it."""

    def __init__(self, opened: Opened) -> None:
        self._externals, self._places = opened.external_trajectories, Places(opened)
        self._drawn: dict[str, tuple[Placed, int]] = {}
        """By entity of a line: the trajectory from which it was drawn, and the number of its last pose."""
        self._seen: set[str] = set()
        """Names of trajectories whose pose is drawn now."""

    def opening(self) -> Iterator[Entry]:
        """Names and colours of their error curves (static)."""
        for external in self._externals:
            series = rr.SeriesLines(names=external.name, colors=external.colour, widths=1.5)
            yield Entry(f"plots/error/beside/{external.name}", series, static=True)

    def errors(self, index: int) -> Iterator[Entry]:
        for external in self._externals:
            if np.isfinite(error := external.errors_m[index]):
                yield Entry(f"plots/error/beside/{external.name}", rr.Scalars(error))

    def at(
        self, index: int, time_ns: int, model: RunModel, placements: Mapping[str, Similarity], outlines: Array
    ) -> Iterator[Entry]:
        """Yields the entities that differ from those of the frame before. `model` is that after this frame; `outlines`
        (L, P, 3) are those of the rig's cameras in the rig."""
        found = self._places.at(model, placements)
        for external in self._externals:
            if (placed := found.get(external.name)) is not None:
                yield from self._path(external, placed, placed.count(time_ns))
                yield from self._pose(external, placed, index, outlines)

    def _path(self, external: ExternalTrajectory, placed: Placed, count: int) -> Iterator[Entry]:
        for start in range(0, count, POSES_PER_LINE):
            path, end = (
                f"world/beside/{external.name}/path/{start // POSES_PER_LINE}",
                min(start + POSES_PER_LINE, count),
            )
            if self._drawn.get(path) != (placed, end):
                self._drawn[path] = placed, end
                yield Entry(
                    path,
                    entities.lines([placed.poses.translations[max(start - 1, 0) : end]], external.colour, WIDTH_PX),
                )

    def _pose(self, external: ExternalTrajectory, placed: Placed, index: int, outlines: Array) -> Iterator[Entry]:
        place, pose = f"world/beside/{external.name}/rig", placed.pose(index)
        if pose is not None:
            yield Entry(place, entities.transform(pose))
            size = float(np.ptp(outlines.reshape(-1, 3), axis=0).max())
            end = (
                pose.translation - 2 * (1 + external.number) * size * entities.NAME_STEP
            )  # away from the names of methods
            colour = colours.colour_of_external(external.number)
            yield Entry(f"world/beside/{external.name}/name", entities.name(external.name, end, colour))
            if external.name not in self._seen:
                self._seen.add(external.name)
                yield Entry(place, entities.lines(outlines, colours.colour_of_external(external.number), 1.5))
        elif external.name in self._seen:
            self._seen.discard(external.name)
            yield Entry(place, rr.Clear(recursive=False))
