"""The branches that are drawn together with the shown one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...session.state import State
from .branches import Beside
from .service import BranchService
from .state import Branches

if TYPE_CHECKING:
    from ...session.session import Session


def branches_beside(session: Session, state: State) -> dict[int, Beside]:
    """By number, those that are not hidden, as of the shown frame or their last before it."""
    found = {}
    for branch in state[Branches].all:
        run = session.service(BranchService).run_of(branch.number)
        last = run.history.last if run is not None else None
        if run is not None and last is not None and branch.number != state[Branches].shown and not branch.hidden:
            model = run.known_at(min(state.index, last.index))
            found[branch.number] = Beside(model, last.placements, branch.colour)
    return found
