"""The trajectories of other programs in a recording: /world/beside/NAME and /plots/error/beside/NAME.

Frame-synchronised: at a frame there is what lies up to its time, and the pose interpolated there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from ispom.geometry import Array, Similarity

from ...engine.events import Opened, Stepped
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
    """Follows one run."""

    def __init__(self, opened: Opened) -> None:
        self._beside, self._places = opened.beside, Places(opened)
        self._lines: dict[str, Placed] = {}
        """What each was drawn from."""
        self._counts: dict[str, int] = {}
        """Poses of each that are drawn."""
        self._seen: set[str] = set()
        """Those whose pose is drawn now."""

    def opening(self) -> Iterator[Entry]:
        """Names and colours of their error curves (static)."""
        for beside in self._beside:
            series = rr.SeriesLines(names=beside.name, colors=beside.colour, widths=1.5)
            yield Entry(f"plots/error/beside/{beside.name}", series, static=True)

    def stepped(
        self, event: Stepped, model: RunModel, placements: Mapping[str, Similarity], outlines: Array
    ) -> Iterator[Entry]:
        """`model` is that after the event; `outlines` (L, P, 3) of the rig's cameras in the rig."""
        found = self._places.at(model, placements)
        for beside in self._beside:
            if (placed := found.get(beside.name)) is not None:
                yield from self._path(beside, placed, placed.count(event.exposure.time_ns))
                yield from self._pose(beside, placed, event.index, outlines)
            if np.isfinite(error := beside.errors_m[event.index]):
                yield Entry(f"plots/error/beside/{beside.name}", rr.Scalars(error))

    def _path(self, beside: Beside, placed: Placed, count: int) -> Iterator[Entry]:
        anew = self._lines.get(beside.name) is not placed
        before = 0 if anew else self._counts[beside.name]
        self._lines[beside.name], self._counts[beside.name] = placed, count
        if count == before:
            return
        for start in range(before - before % POSES_PER_LINE, count, POSES_PER_LINE):
            xyz = placed.poses.translations[max(start - 1, 0) : min(start + POSES_PER_LINE, count)]
            line = entities.lines([xyz], beside.colour, WIDTH_PX)
            yield Entry(f"world/beside/{beside.name}/path/{start // POSES_PER_LINE}", line)

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
