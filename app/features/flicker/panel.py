"""Flicker: one image with the tracks of one side, then of the other; the 3-D view shows their paths and points."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import viser

from ispom.errors import InputError
from ispom.types import Image

from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.viser.markup import renderer
from ...views.viser.panels import Panel
from ...views.viser.track_picture import image_of, picture, tracks_of
from ..branches.service import BranchService
from ..branches.state import Branches
from .commands import Flick, FlickerBetween, StopFlicker
from .flicker import Flicker, Side, sides
from .state import Flickering

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

NONE: tuple[str, ...] = ("-",)
TURN, OFF = "A / B", "Stop"
PLAYING_S = 0.5
"""Between two pictures while it plays: each is read from the source, and sent twice."""


class FlickerPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._gui, self._session = gui, session
        self._sides: dict[str, Side] = {}
        self._drawn: tuple[object, ...] = ()
        self._due_s = 0.0
        self._pictures: dict[str, viser.GuiImageHandle] = {}
        self._folder = gui.add_folder("Flicker", expand_by_default=False)
        with self._folder:
            hint = "A method in a branch. The other views show all as usual once this is off."
            self._choices = {name: gui.add_dropdown(name, NONE, hint=hint) for name in "AB"}
            self._buttons = gui.add_button_group("", (TURN, OFF), hint="A / B draws the other side. Key: x")
            self._text = gui.add_html(_text(session.state, ""))
        for choice in self._choices.values():
            choice.on_update(self._chosen)
        self._buttons.on_click(self._clicked)
        self._shown: Flicker | None = None

    def _chosen(self, _: object) -> None:
        a, b = (self._sides.get(choice.value) for choice in self._choices.values())
        before = (self._shown.a, self._shown.b) if self._shown is not None else None
        if a is not None and b is not None and a != b and (a, b) != before:
            self._session.post(FlickerBetween(a, b))

    def _clicked(self, _: object) -> None:
        self._session.post({TURN: Flick(), OFF: StopFlicker()}[self._buttons.value])

    def show(self, state: State) -> None:
        self._offer(state)
        between = state[Flickering].between
        said = self._draw(state) if between is not None else ""
        for name, drawn in self._pictures.items():
            visible = between is not None and not said and name == ("b" if between.on_b else "a")
            if drawn.visible != visible:
                drawn.visible = visible
        if (text := _text(state, said)) != self._text.content:
            self._text.content = text

    def _offer(self, state: State) -> None:
        self._sides = {_label(side, state): side for side in sides(state[Branches].all, self._methods)}
        options = (*NONE, *self._sides)
        self._shown = between = state[Flickering].between
        chosen = (between.a, between.b) if between is not None else (None, None)
        for choice, side in zip(self._choices.values(), chosen, strict=True):
            if tuple(choice.options) != options:
                choice.options = options
            value = _label(side, state) if side is not None else NONE[0]
            if side is not None and choice.value != value:
                choice.value = value

    def _methods(self, number: int) -> tuple[str, ...]:
        run = self._session.service(BranchService).run_of(number)
        return run.opened.methods if run is not None else ()

    def _draw(self, state: State) -> str:
        """Both pictures of the frame shown; what keeps them from being drawn, where something does."""
        flicker, run = state[Flickering].between, self._session.run
        wanted = (run, state.index, flicker and flicker.a, flicker and flicker.b)
        if wanted == self._drawn or flicker is None or run is None or state.index < 0:
            return ""
        if state.playing and time.monotonic() < self._due_s:
            return ""
        self._drawn, self._due_s = wanted, time.monotonic() + PLAYING_S
        try:
            camera, image = image_of(run.playback.sequence[state.index])
        except InputError as fault:
            self._drawn = ()
            return str(fault)
        for name, side in (("a", flicker.a), ("b", flicker.b)):
            shown = self._session.service(BranchService).run_of(side.branch)
            self._put(name, _picture(shown, side.method, state.index, camera, image))
        return ""

    def _put(self, name: str, image: Image) -> None:
        if name in self._pictures:
            self._pictures[name].image = image
            return
        with self._folder:
            self._pictures[name] = self._gui.add_image(image, format="jpeg", jpeg_quality=85, visible=False)


def _picture(run: CurrentRun | None, method: str, index: int, camera: str, image: Image) -> Image:
    known = run is not None and index < len(run.history)
    return picture(image, tracks_of(run.history[index], method, camera) if known and run is not None else None)


def _label(side: Side, state: State) -> str:
    names = {branch.number: branch.name for branch in state[Branches].all}
    return f"{side.branch} {names.get(side.branch, '')}: {colours.label(side.method)}"


def _text(state: State, said: str) -> str:
    between = state[Flickering].between
    if between is None:
        return render("flicker.html", side=None, label="", said="")
    side = "B" if between.on_b else "A"
    return render("flicker.html", side=side, label=_label(between.shown, state), said=said)


PANELS = (Panel("Compare", 430, FlickerPanel),)
