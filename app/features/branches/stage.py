"""The trajectories of branches that are not shown, on the stage beside those of the one that is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ispom.geometry import Similarity

from ...views.rerun import entities
from ...views.rerun.batch import Entry
from .branches import Beside

WIDTH_PX = 0.75
"""Half width of the lines on the screen."""


def trajectories(branches: Mapping[int, Beside], hidden: frozenset[str]) -> Iterator[Entry]:
    """A line for each branch and method, in the branch's colour; without the hidden methods."""
    for number, branch in branches.items():
        for method, known in branch.model.methods.items():
            blocks = sorted(known.poses.drawn_blocks())
            if method in hidden or not blocks:
                continue
            placement = branch.placements.get(method, Similarity())
            lines = [placement.apply(np.asarray(line)) for block in blocks for line in known.poses.lines(block)]
            yield Entry(f"world/branches/{number}/{method}", entities.lines(lines, branch.colour, WIDTH_PX))
