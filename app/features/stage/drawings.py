"""What is drawn over the frames of the shown run, and what each drawing is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache

from ...engine.inspection.looked import Looked
from ...session.current_run import CurrentRun
from ...session.session import Session
from ...session.state import State
from ...views.rerun.batch import Entry
from ..branches.stage import trajectories
from ..flicker.stage import side
from ..integration.integration import latest_fit
from ..integration.stage import entries
from ..lessons.learning import covered
from ..tracks.stage import in_images, in_world
from ..tracks.tab import looked_at


@dataclass(frozen=True)
class Drawing:
    """Made again when one of the values that it is made of has changed."""

    name: str
    made_of: tuple[object, ...]
    entries: Callable[[], Iterable[Entry]]
    takes_long: bool = False
    is_of_frame: bool = False
    """Whether it is to be seen over the frame shown alone."""


def drawings(session: Session, state: State, run: CurrentRun) -> list[Drawing]:
    """All of them, those that are empty included. None shows while a question of a lesson is open: they would answer
    it."""
    if covered(state) is not state:
        return []
    shown, selected, geometry = (run, state.displayed), state.selected, state.look == "geometry"
    looked = cache(lambda: looked_at(session, state))

    def closely(wanted: bool, draw: Callable[[Looked], Iterable[Entry]]) -> Iterable[Entry]:
        found = looked() if wanted else None
        return draw(found) if found is not None else ()

    found = [
        Drawing("track", (selected and shown,), lambda: closely(bool(selected), in_images), is_of_frame=True),
        Drawing(
            "look",
            ((selected or geometry) and shown, selected, geometry),
            lambda: closely(bool(selected) or geometry, lambda it: in_world(it, geometry=geometry)),
            takes_long=True,
        ),
    ]
    flicker, step = state.flicker, state.integration
    others = tuple(b.number for b in state.branches if not b.hidden and b.number != state.branch) if not flicker else ()
    found += [
        Drawing(
            "branches",
            (others and shown, others, state.hidden),
            lambda: trajectories(session.beside(state) if others else {}, state.hidden),
            takes_long=True,
        ),
        Drawing("integration", (step, step and shown), lambda: _fitted(state, run)),
    ]
    for name, of in (("a", flicker.a), ("b", flicker.b)) if flicker is not None else (("a", None), ("b", None)):
        other = session.branch(of.branch) if of is not None else None
        draw = (lambda n=name, o=of, r=other: side(n, o, r, state.index)) if of and other else tuple
        found.append(Drawing(f"flicker {name}", (of, other, of and shown), draw, takes_long=True))
    return found


def _fitted(state: State, run: CurrentRun) -> Iterable[Entry]:
    found = latest_fit(run, state.integration.method, state.index) if state.integration is not None else None
    return entries(found[1], state.integration.stage) if found is not None and state.integration is not None else ()
