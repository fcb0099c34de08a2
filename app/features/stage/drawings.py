"""What is drawn over the frames of the shown run, and what each drawing is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache

from ...engine.inspection.looked import Looked
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.session import Session
from ...session.state import State, covered
from ...views.rerun.batch import Entry
from ..branches.stage import trajectories, visible_branches
from ..external_paths.stage import paths_of_others, shows_recording
from ..integration.commands import IntegrationSteps
from ..integration.drawing import entries
from ..integration.integration import Integration, latest_fit
from ..layers.stage import depth_of, pair_shown
from ..layers.state import Layers
from ..tracks.commands import Inspection
from ..tracks.panel import looked_at
from ..tracks.stage import in_images, in_world


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
    inspection, branches, hidden = state[Inspection], state[Branches], state[Layers].hidden
    shown, selected, geometry = (run, state.displayed), inspection.selected, inspection.panel == "geometry"
    looked = cache(lambda: looked_at(session, state))

    def closely(visible: bool, draw: Callable[[Looked], Iterable[Entry]]) -> Iterable[Entry]:
        found = looked() if visible else None
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
    step = state[IntegrationSteps].shown
    pair, is_over = pair_shown(state, run), shows_recording(run)
    others = tuple(b.number for b in branches.all if not b.hidden and b.number != branches.shown)
    found += [
        Drawing(
            "branches",
            (others and shown, others, hidden),
            lambda: trajectories(visible_branches(session, state) if others else {}, hidden),
            takes_long=True,
        ),
        Drawing(
            "depth",
            (run, pair, pair is not None and hidden),
            lambda: depth_of(pair, state, run) if pair is not None else (),
            takes_long=True,
        ),
        Drawing("external paths", (is_over and shown,), lambda: paths_of_others(run, state.index) if is_over else ()),
        Drawing("integration", (step, step and shown), lambda: _fitted(step, state, run)),
    ]
    return found


def _fitted(step: Integration | None, state: State, run: CurrentRun) -> Iterable[Entry]:
    found = latest_fit(run, step.method, state.index) if step is not None else None
    return entries(found[1], step.stage) if found is not None and step is not None else ()
