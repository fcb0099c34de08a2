"""Where trajectories of other programs are drawn among the methods', at each frame of a run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ispom.evaluation.trajectory_error import Alignment, placed
from ispom.geometry import Similarity
from ispom.methods import method as registered
from ispom.types import Trajectory

from ..events import Opened
from ..model.drawn_size import drawn_truth
from ..model.run_model import RunModel
from .placed import Placed

NEEDS_UNIT: dict[Alignment, Alignment] = {"se3": "sim3"}
"""By alignment for metric methods: the alignment with a method whose unit is not the metre."""


class Places:
    """Aligns trajectories of other programs with the shared world, and keeps them by name.

    Where the ground truth is drawn, they are aligned with it once. Otherwise they are aligned with the poses so far of
    the first metric method (without one, of the first method), again whenever there are twice as many. With neither
    truth nor methods they are not drawn.
    """

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self._fixed = drawn_truth(opened.truth, opened.methods) is not None
        metric = [m for m in opened.methods if registered(m).unit == "metric"]
        self._method = next(iter([*metric, *opened.methods]), "")
        self._found: dict[str, Placed] = {}
        self._doublings = 0

    def at(self, model: RunModel, placements: Mapping[str, Similarity]) -> Mapping[str, Placed]:
        """The placed trajectories at a frame, by name. The same objects until they are aligned again."""
        externals = self._opened.external_trajectories
        if self._fixed:
            self._found = self._found or {b.name: b.of_truth for b in externals if b.of_truth is not None}
        elif externals and self._method and (doublings := self._count(model).bit_length()) != self._doublings:
            self._doublings = doublings
            known = doublings > 0
            self._found = self._aligned(self._reference(model, placements, 2 ** (doublings - 1))) if known else {}
        return self._found

    def _count(self, model: RunModel) -> int:
        return sum(int(block.known.sum()) for block in model.methods[self._method].poses.blocks)

    def _reference(self, model: RunModel, placements: Mapping[str, Similarity], most: int) -> Trajectory:
        """shared_world_from_rig: the first poses of the method."""
        known, rig = model.methods[self._method].poses.trajectory(model.times), self._opened.sequence.rig
        poses = placed(known.select(np.arange(min(most, len(known)))), placements.get(self._method, Similarity()))
        return poses.moved(right=rig.rig_from(poses.frame).inverse(), frame="rig")

    def _aligned(self, reference: Trajectory) -> dict[str, Placed]:
        own_unit = registered(self._method).unit == "own"
        placed_by_name = {}
        for external in self._opened.external_trajectories:
            kind = external.option.alignment
            kind = NEEDS_UNIT.get(kind, kind) if own_unit else kind
            against = f"the poses of {self._method.replace('_', ' ')}"
            aligned = external.placed(reference, against, self._opened.sequence.rig, kind)
            if aligned is not None:
                placed_by_name[external.name] = aligned
        return placed_by_name
