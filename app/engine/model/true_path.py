"""Where the true path of a run is drawn: as it is, or aligned to the estimates where their worlds are elsewhere."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ispom.evaluation.trajectory_error import Alignment, alignment_of, error_against_truth
from ispom.geometry import Similarity
from ispom.methods import method as registered

from ..events import Opened
from .drawn_size import drawn_truth
from .run_model import RunModel

FIRST, GROWTH = 8, 1.25
"""Poses from which on it is aligned, and the factor by which there are more of them when it is aligned again: all of
that together costs a few times one alignment over all poses."""


class TruePath:
    """A single camera's unit is free, and the world of some metric methods is elsewhere. Sim(3) or SE(3) brings their
    path to the truth, and the inverse the truth to their path."""

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self.fixed = drawn_truth(opened.truth, opened.methods) is not None
        """Whether it is drawn as it is."""
        metric = [name for name in opened.methods if registered(name).unit == "metric"]
        self._method = next(iter([*metric, *opened.methods]), "")
        """Whose world is the shared one otherwise."""
        self._alignment: Alignment = alignment_of(bool(metric))
        self._found: Similarity | None = Similarity() if self.fixed else None
        self._count = 0
        """Poses that it was aligned to."""

    def at(self, model: RunModel, placements: Mapping[str, Similarity], *, ended: bool = False) -> Similarity | None:
        """Shared world from the truth's world, by what is known now; None where that is too little.

        The same object for as long as it was not aligned again. `ended`: to all poses, not only to most of them.
        """
        if self.fixed or self._opened.truth is None or self._method not in model.methods:
            return self._found
        poses = model.methods[self._method].poses
        known = sum(int(block.known.sum()) for block in poses.blocks)
        count = known if ended and known >= FIRST else _step(known)
        if count != self._count:
            self._count = count
            trajectory = poses.trajectory(model.times)
            own = trajectory.select(np.arange(min(count, len(trajectory))))
            error = error_against_truth(own, self._opened.truth, self._opened.sequence.rig, self._alignment)
            placement = placements.get(self._method, Similarity())
            self._found = placement @ error.reference_from_estimate.inverse() if error is not None else None
        return self._found


def _step(known: int) -> int:
    """The largest number of poses, of those at which the path is aligned, that are known; 0 for none."""
    count = 0
    following = FIRST
    while following <= known:
        count, following = following, int(following * GROWTH) + 1
    return count
