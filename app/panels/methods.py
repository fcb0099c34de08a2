"""Methods: which run, and their settings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ispom.estimators import METHODS, Config

from .. import commands as do
from ..controls import ConfigForm
from ..state import State

if TYPE_CHECKING:
    from ..session import Session

FRESH = "Changes count when you apply them: the run then starts again from the first exposure."
PENDING = "**Changed, not applied yet.** Applying starts the run again from the first exposure."


class MethodsPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._gui, self._session, self._run = gui, session, -1
        config = session.state.config
        self._on, self._forms = {}, {}
        for method in METHODS:
            self._on[method] = gui.add_checkbox(method, True, hint=f"run the {method} method")
            self._on[method].on_update(lambda _: self._hint())
        for method in METHODS:
            with gui.add_folder(f"{method} settings", expand_by_default=False):
                self._forms[method] = ConfigForm(gui, getattr(config, method), lambda _: self._hint())
        self._text = gui.add_markdown(FRESH)
        self._apply = gui.add_button("Apply and start again", icon=viser.Icon.REFRESH)
        self._apply.on_click(lambda _: session.post(do.Restart(self._chosen, self._config)))
        gui.add_button("Back to the defaults", icon=viser.Icon.RESTORE, color="gray").on_click(self._defaults)

    @property
    def _config(self) -> Config:
        return Config(**{method: form.value for method, form in self._forms.items()})

    @property
    def _chosen(self) -> tuple:
        return tuple(m for m in METHODS if self._on[m].value and m in self._session.state.possible)

    def _defaults(self, _: object) -> None:
        for method, form in self._forms.items():
            form.show(getattr(Config(), method))
        self._hint()

    def _hint(self) -> None:
        state = self._session.state
        same = self._config == state.config and self._chosen == state.methods
        self._text.content = FRESH if same else PENDING

    def show(self, state: State) -> None:
        if state.run == self._run:
            return
        self._run = state.run
        for method, box in self._on.items():
            box.disabled = method not in state.possible
            box.value = method in state.methods
        for method, form in self._forms.items():
            form.show(getattr(state.config, method))
        self._hint()
