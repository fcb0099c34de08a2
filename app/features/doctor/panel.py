"""Above the events: why did it go wrong at the frame shown? Progress, the ranking, and a button that cancels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ...session.state import State
from ...views.viser.panels import Panel, renderer
from .commands import CancelExamination, Examine, ForkWithRemedy
from .state import Examined
from .text import SHOWN, rerun_table

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)
HINT = "Examines the frames before and after the one shown: which single cause explains best what went wrong there?"
FORK = "Fork with what helped"
FORK_HINT = "Keeps this run, and runs on from before the stretch with the setting that helped most, as a branch."
CANCEL_HINT = "Ends the examination without an answer."


class DoctorPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._examine = gui.add_button("Find the cause", icon=viser.Icon.STETHOSCOPE, hint=HINT, color="gray")
        self._examine.on_click(lambda _: session.post(Examine()))
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, hint=CANCEL_HINT, color="gray", visible=False)
        self._cancel.on_click(lambda _: session.post(CancelExamination()))
        self._fork = gui.add_button(FORK, icon=viser.Icon.GIT_FORK, hint=FORK_HINT, color="gray", visible=False)
        self._fork.on_click(lambda _: session.post(ForkWithRemedy()))
        self._text = gui.add_html("")

    def show(self, state: State) -> None:
        examined = state[Examined]
        running = examined.progress is not None
        if self._cancel.visible != running:
            self._cancel.visible, self._examine.visible = running, not running
        helped = examined.diagnosis is not None and examined.diagnosis.helped is not None
        if self._fork.visible != helped:
            self._fork.visible = helped
        if (text := text_of(examined)) != self._text.content:
            self._text.content = text


def text_of(examined: Examined) -> str:
    """Returns the examination as HTML."""
    found = examined.diagnosis
    ranked = () if found is None else found.ranked[:SHOWN]
    reruns = [] if found is None else [each for each in (found.set_back, found.reruns) if each is not None]
    tables = [(each, rerun_table(each)) for each in reruns]
    return render("doctor.html", examined=examined, found=found, ranked=ranked, tables=tables)


PANELS = (Panel("Explain", 101, DoctorPanel),)
