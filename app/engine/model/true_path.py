"""Where the true path of a run is drawn: unchanged, or aligned with the estimates where their worlds differ from it."""

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
"""Least number of poses with which the path is aligned, and the factor by which they must grow before it is aligned
again. All alignments together take a few times as long as one over all poses."""


class TruePath:
    """The placement of the true path. A single camera has a free unit, and some metric methods have a world of their
    own: Sim(3) or SE(3) aligns their path with the truth, and its inverse places the truth at their path."""

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self.fixed = drawn_truth(opened.truth, opened.methods) is not None
        """Whether the path is drawn without an alignment."""
        metric = [name for name in opened.methods if registered(name).unit == "metric"]
        self._method = next(iter([*metric, *opened.methods]), "")
        """Otherwise the method whose path it is aligned with."""
        self._alignment: Alignment = alignment_of(bool(metric))
        self._found: Similarity | None = Similarity() if self.fixed else None
        self._count = 0
        """Number of poses of the latest alignment."""

    def at(self, model: RunModel, placements: Mapping[str, Similarity], *, ended: bool = False) -> Similarity | None:
        """Returns the shared world from the truth's world, by the poses known now; None with too few poses.

        It is the same object until it is aligned again. `ended`: aligns with all poses, not only with most of them.
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
    """Returns the largest number of poses, up to `known`, at which the path is aligned; 0 for none."""
    count = 0
    following = FIRST
    while following <= known:
        count, following = following, int(following * GROWTH) + 1
    return count
