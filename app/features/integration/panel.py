"""The integration, step by step (Fig. 7): previous and next step, the numbers below; the 3-D view shows the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ispom.methods import method as registered
from ispom.types import Step

from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.viser.markup import renderer
from ...views.viser.panels import Panel
from .commands import IntegrationSteps, ShowIntegration, StepIntegration
from .integration import Integration, latest_fit
from .numbers import table

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

OFF: tuple[str, ...] = ("off",)
PREVIOUS, NEXT = "◀ Previous step", "Next step ▶"
STEP_HINT = "The step before or after, in the 3-D view."


class IntegrationPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._state = session, session.state
        self._found: tuple[tuple[object, ...], tuple[int, Step] | None] = ((), None)
        with gui.add_folder("Integration, step by step", expand_by_default=False):
            hint = "How the latest fit up to the frame shown came about, in the 3-D view beside."
            self._method = gui.add_dropdown("integration", OFF, hint=hint)
            self._method.on_update(self._chosen)
            self._buttons = gui.add_button_group("", (PREVIOUS, NEXT), visible=False, hint=STEP_HINT)
            self._buttons.on_click(self._clicked)
            self._text = gui.add_html("", visible=False)

    def _chosen(self, _: object) -> None:
        wanted = next((m for m in _methods(self._state) if colours.label(m) == self._method.value), "")
        shown = self._state[IntegrationSteps].shown
        if wanted != (shown.method if shown is not None else ""):
            self._session.post(ShowIntegration(wanted))

    def _clicked(self, _: object) -> None:
        self._session.post(StepIntegration({PREVIOUS: -1, NEXT: 1}[self._buttons.value]))

    def show(self, state: State) -> None:
        self._state = state
        shown = state[IntegrationSteps].shown
        options = (*OFF, *map(colours.label, _methods(state)))
        if tuple(self._method.options) != options:
            self._method.options = options
        value = colours.label(shown.method) if shown is not None else OFF[0]
        if self._method.value != value and value in options:
            self._method.value = value
        self._look_up(shown, state)
        self._buttons.visible = self._text.visible = shown is not None
        text = _text(self._found[1], shown.stage) if shown is not None else ""
        if text != self._text.content:
            self._text.content = text

    def _look_up(self, shown: Integration | None, state: State) -> None:
        run: CurrentRun | None = self._session.run
        asked = (run, shown.method if shown is not None else "", state.index)
        if asked != self._found[0]:
            found = latest_fit(run, shown.method, state.index) if run is not None and shown is not None else None
            self._found = asked, found


def _methods(state: State) -> tuple[str, ...]:
    """Those that build on others: what they integrate."""
    return tuple(m for m in state.methods if registered(m).asks)


def _text(found: tuple[int, Step] | None, stage: int) -> str:
    if found is None:
        return render("integration.html", index=None, found={})
    return render("integration.html", index=found[0], found=table(found[1], stage))


PANELS = (Panel("View", 600, IntegrationPanel),)
