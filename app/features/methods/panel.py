"""Methods: which of them run, in any combination, and their settings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ispom.methods import Config, method, names, possible_methods

from ...presentation import colours
from ...session import commands as do
from ...session.branches.branches import differences
from ...session.state import State
from ...views.viser.controls import ConfigForm
from ...views.viser.panels import Panel
from ..branches.commands import Fork

if TYPE_CHECKING:
    from ...session.session import Session

APPLIED = "Apply restarts the run from the first frame; Fork runs on from the one after that shown."
PENDING = f"**Changed, not applied yet.** {APPLIED}"
FORK = "Fork"
APPLY_HINT = "Starts the run again from the first frame with these methods and settings, without its branches."
ALWAYS = ("monocular", "stereo", "integrated")
"""The methods of the paper, which always have a box; others have one where they run."""
MORE: str = "choose a method"
"""Entry of the list of more methods while none is chosen; a chosen method gets a box above."""
RESTORE_HINT = "Puts all settings below back to their defaults; Apply or Fork makes them count."


class MethodsPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._state, self._run = session, session.state, -1
        config, running = self._state.config, self._state.methods
        self._on = {m: self._box(gui, m, m in running) for m in names()}
        hint = "Type a few letters of a method of the survey, or of the methods as they were published in 2013."
        self._more = gui.add_dropdown("More methods", (MORE,), hint=hint)
        self._more.on_update(lambda _: self._add(self._more.value))
        for box in self._on.values():
            box.on_update(lambda _: self._hint())
        self._folders: dict[str, viser.GuiFolderHandle] = {}
        self._forms: dict[str, ConfigForm] = {}
        self._text = gui.add_markdown(APPLIED)
        self._apply = gui.add_button("Apply and restart", icon=viser.Icon.REFRESH, hint=APPLY_HINT)
        self._apply.on_click(lambda _: session.post(do.Restart(self._chosen, self._config)))
        hint = "Keeps this run, and runs on from the frame shown with these methods and settings, as a branch."
        self._fork = gui.add_button(FORK, icon=viser.Icon.GIT_FORK, hint=hint, disabled=True)
        self._fork.on_click(lambda _: session.post(Fork(self._chosen, self._config)))
        restore = gui.add_button("Restore defaults", icon=viser.Icon.RESTORE, color="gray", hint=RESTORE_HINT)
        restore.on_click(self._defaults)
        for name in names():
            self._folders[name] = gui.add_folder(f"{colours.label(name)} settings", expand_by_default=False)
            with self._folders[name]:
                self._forms[name] = ConfigForm(gui, config.of(name), lambda _: self._hint())
        self._arrange()

    @staticmethod
    def _box(gui: viser.GuiApi, name: str, on: bool) -> viser.GuiCheckboxHandle:
        of_survey = method(name).survey
        hint = f"{of_survey}. {method(name).source}" if of_survey else method(name).source
        return gui.add_checkbox(colours.label(name), on, hint=hint)

    @property
    def _config(self) -> Config:
        """What the inputs say."""
        return Config({name: form.value for name, form in self._forms.items()})

    @property
    def _possible(self) -> tuple[str, ...]:
        opened = self._session.opened
        return possible_methods(opened.sequence.rig) if opened else ()

    @property
    def _chosen(self) -> tuple[str, ...]:
        return tuple(m for m in self._possible if self._on[m].value)

    def _defaults(self, _: object) -> None:
        self._show(Config())
        self._hint()

    def _show(self, config: Config) -> None:
        for name, form in self._forms.items():
            form.show(config.of(name))

    def _arrange(self) -> None:
        """Offers what the source has the cameras for; the settings of what is switched on."""
        possible = self._possible
        for name, box in self._on.items():
            box.disabled = name not in possible
            box.visible = name in ALWAYS or bool(box.value)
        others = sorted(colours.label(m) for m in possible if not self._on[m].visible)
        self._more.options = (MORE, *others)
        self._more.visible = bool(others)
        self._hint()

    def _add(self, label: str) -> None:
        """Switches a method of the list on, which then has a box like the others."""
        name = next((m for m in self._possible if colours.label(m) == label), None)
        if name is not None:
            self._on[name].value = True
            self._more.value = MORE
            self._arrange()

    def _hint(self) -> None:
        state = self._state
        for name, folder in self._folders.items():
            folder.visible = bool(self._on[name].value)
            other = differences(name, Config().of(name), self._forms[name].value)
            label = f"{colours.label(name)} settings{f' · {len(other)} not default' if other else ''}"
            if folder.label != label:
                folder.label = label
        applied = all(state.config.of(name) == form.value for name, form in self._forms.items())
        self._text.content = APPLIED if applied and self._chosen == state.methods else PENDING

    def show(self, state: State) -> None:
        self._state = state
        label = FORK if state.index < 0 else f"{FORK} at frame {state.index + 1}"
        if self._fork.label != label:
            self._fork.label = label
            self._fork.disabled = not 0 <= state.index < state.total - 1
        if state.run == self._run:
            return
        self._run = state.run
        for name, box in self._on.items():
            box.value = name in state.methods
        self._show(state.config)
        self._arrange()


PANELS = (Panel("Methods", 300, MethodsPanel),)
