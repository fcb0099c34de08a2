"""The trajectories of other programs in a recording: /world/beside/NAME and /plots/error/beside/NAME.

Frame-synchronised: at a frame there is what lies up to its time, and the pose interpolated there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from ispom.geometry import Array, Similarity

from ...engine.events import Opened
from ...engine.external_trajectories.placed import Beside, Placed
from ...engine.external_trajectories.places import Places
from ...engine.model.run_model import RunModel
from ...presentation import colours
from . import entities
from .batch import Entry

POSES_PER_LINE = 100
"""So many are logged again when there is one more."""
WIDTH_PX = 1.2


class BesideLog:
    """Follows one run, or draws one frame of it."""

    def __init__(self, opened: Opened) -> None:
        self._beside, self._places = opened.beside, Places(opened)
        self._drawn: dict[str, tuple[Placed, int]] = {}
        """By entity of a line: what it was drawn from, and the number of its last pose."""
        self._seen: set[str] = set()
        """Those whose pose is drawn now."""

    def opening(self) -> Iterator[Entry]:
        """Names and colours of their error curves (static)."""
        for beside in self._beside:
            series = rr.SeriesLines(names=beside.name, colors=beside.colour, widths=1.5)
            yield Entry(f"plots/error/beside/{beside.name}", series, static=True)

    def errors(self, index: int) -> Iterator[Entry]:
        for beside in self._beside:
            if np.isfinite(error := beside.errors_m[index]):
                yield Entry(f"plots/error/beside/{beside.name}", rr.Scalars(error))

    def at(
        self, index: int, time_ns: int, model: RunModel, placements: Mapping[str, Similarity], outlines: Array
    ) -> Iterator[Entry]:
        """What differs from the frame before. `model` is as known after this one; `outlines` (L, P, 3) of the rig's
        cameras in the rig."""
        found = self._places.at(model, placements)
        for beside in self._beside:
            if (placed := found.get(beside.name)) is not None:
                yield from self._path(beside, placed, placed.count(time_ns))
                yield from self._pose(beside, placed, index, outlines)

    def _path(self, beside: Beside, placed: Placed, count: int) -> Iterator[Entry]:
        for start in range(0, count, POSES_PER_LINE):
            path, end = f"world/beside/{beside.name}/path/{start // POSES_PER_LINE}", min(start + POSES_PER_LINE, count)
            if self._drawn.get(path) != (placed, end):
                self._drawn[path] = placed, end
                yield Entry(
                    path, entities.lines([placed.poses.translations[max(start - 1, 0) : end]], beside.colour, WIDTH_PX)
                )

    def _pose(self, beside: Beside, placed: Placed, index: int, outlines: Array) -> Iterator[Entry]:
        place, pose = f"world/beside/{beside.name}/rig", placed.pose(index)
        if pose is not None:
            yield Entry(place, entities.transform(pose))
            if beside.name not in self._seen:
                self._seen.add(beside.name)
                yield Entry(place, entities.lines(outlines, colours.beside(beside.number), 1.5))
        elif beside.name in self._seen:
            self._seen.discard(beside.name)
            yield Entry(place, rr.Clear(recursive=False))
