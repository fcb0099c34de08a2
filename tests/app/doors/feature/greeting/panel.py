from __future__ import annotations

import viser
from ispom_app.session.session import Session
from ispom_app.session.state import State
from ispom_app.views.viser.panels import Panel

from .state import Greetings


class GreetingPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self.text = gui.add_html("")

    def show(self, state: State) -> None:
        self.text.content = f"greeted {state[Greetings].count} times"


PANELS = (Panel("Greetings", 5, GreetingPanel),)
