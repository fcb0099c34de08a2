"""Run: what is open, and the keys of the run as entries of the command palette. The time dock moves through it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ...session import commands as do
from ...session.actions import ACTIONS
from ...session.state import State
from ..markup import render

if TYPE_CHECKING:
    from ...session.session import Session

TOLD_S = 6.0
"""How long a person reads that nothing is open yet, as in the page (notices.js)."""


class RunPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self._text = gui.add_html(_text(session.state))
        # Their keys are the page's (keyboard.js): two that listen would step twice.
        self._commands: list[viser.CommandHandle] = []
        for action in ACTIONS:
            entry = gui.add_command(action.label, description=f"{action.hint} Key: {action.key}")
            entry.on_trigger(lambda event, wanted=action.command: self._move(event, wanted))
            self._commands.append(entry)

    def show(self, state: State) -> None:
        if (text := _text(state)) != self._text.content:
            self._text.content = text

    def _move(self, event: viser.CommandEvent, wanted: do.Command) -> None:
        """Of a source that is still being opened there is nothing to move in yet; later it would come as a surprise."""
        if self._session.state.phase != "opening":
            self._session.post(wanted)
        elif event.client is not None:
            text = "The source is still being opened: moves work once it is."
            event.client.add_notification("Not open yet", text, auto_close_seconds=TOLD_S)


def _text(state: State) -> str:
    """What is open, and what to know of it, as HTML."""
    if state.phase == "opening" and not state.total:
        return render("run.html", text=f"Opening {state.source} …", notes=())
    if state.phase == "failed":
        text = "Nothing is open. Choose a source below, sim:city or a path, and press Open."
        return render("run.html", text=text, notes=(state.failure,))
    finished = ", finished" if state.ended else ""
    return render("run.html", text=f"{state.computed} of {state.total} frames processed{finished}", notes=state.notes)
