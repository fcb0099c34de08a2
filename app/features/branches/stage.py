"""The branches that are drawn together with the shown one, as trajectories on the stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ispom.geometry import Similarity

from ...session.branches.branches import BranchInView
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.state import State
from ...views.rerun import entities
from ...views.rerun.batch import Entry

if TYPE_CHECKING:
    from ...session.session import Session


def visible_branches(session: Session, state: State) -> dict[int, BranchInView]:
    """Returns the other branches that are not hidden, by number, at the shown frame or their last before it."""
    visible = {}
    for branch in state[Branches].all:
        run = session.service(BranchService).run_of(branch.number)
        last = run.history.last if run is not None else None
        if run is not None and last is not None and branch.number != state[Branches].shown and not branch.hidden:
            model = run.known_at(min(state.index, last.index))
            visible[branch.number] = BranchInView(model, last.placements, branch.colour)
    return visible


WIDTH_PX = 0.75
"""Half width of the lines on the screen."""


def trajectories(branches: Mapping[int, BranchInView], hidden: frozenset[str]) -> Iterator[Entry]:
    """A line for each branch and method, in the branch's colour; without the hidden methods."""
    for number, branch in branches.items():
        for method, known in branch.model.methods.items():
            blocks = sorted(known.poses.drawn_blocks())
            if method in hidden or not blocks:
                continue
            placement = branch.placements.get(method, Similarity())
            lines = [placement.apply(np.asarray(line)) for block in blocks for line in known.poses.lines(block)]
            yield Entry(f"{entity_of(number)}/{method}", entities.lines(lines, branch.colour, WIDTH_PX))


def entity_of(number: int) -> str:
    """The path of all that is drawn of a branch."""
    return f"world/branches/{number}"
