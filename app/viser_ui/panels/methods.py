"""Methods: which variant and which of its methods run, and their settings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import viser

from ispom.estimators import (
    ALL_METHODS,
    COMPARED,
    METHODS,
    VARIANTS,
    Config,
    Method,
    ModernConfig,
    Variant,
    possible_methods,
)

from ...session import commands as do
from ...session.state import State
from ..controls import ConfigForm, label_of

if TYPE_CHECKING:
    from ...session.session import Session

FRESH = "Changes count when you apply them: the run then starts again from the first exposure."
PENDING = "**Changed, not applied yet.** Applying starts the run again from the first exposure."


class MethodsPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._run = session, -1
        config = session.state.config
        self._variant = gui.add_dropdown("variant", VARIANTS, initial_value=config.variant, hint="`paper`: as printed")
        self._variant.on_update(lambda _: self._arrange())
        self._on = {m: gui.add_checkbox(label_of(m), m != COMPARED, hint=_hint(m)) for m in ALL_METHODS}
        for box in self._on.values():
            box.on_update(lambda _: self._hint())
        self._folders: dict[tuple[Variant, Method], viser.GuiFolderHandle] = {}
        self._forms: dict[tuple[Variant, Method], ConfigForm] = {}
        for variant, method in _forms():
            folder = gui.add_folder(f"{label_of(method)} settings", expand_by_default=False)
            with folder:
                settings = replace(config, variant=variant).of(method)
                self._forms[variant, method] = ConfigForm(gui, settings, lambda _: self._hint())
            self._folders[variant, method] = folder
        self._text = gui.add_markdown(FRESH)
        self._apply = gui.add_button("Apply and start again", icon=viser.Icon.REFRESH)
        self._apply.on_click(lambda _: session.post(do.Restart(self._chosen, self._config)))
        gui.add_button("Back to the defaults", icon=viser.Icon.RESTORE, color="gray").on_click(self._defaults)
        self._arrange()

    @property
    def _config(self) -> Config:
        """What the inputs say; settings that have none stay."""
        config = self._session.state.config
        for (variant, method), form in self._forms.items():
            config = replace(config, variant=variant).having(method, form.value)
        return replace(config, variant=self._variant.value)

    @property
    def _possible(self) -> tuple[Method, ...]:
        """Of the chosen variant."""
        opened = self._session.opened
        return possible_methods(opened.sequence.rig, self._variant.value) if opened else ()

    @property
    def _chosen(self) -> tuple[Method, ...]:
        return tuple(m for m in self._possible if self._on[m].value)

    def _defaults(self, _: object) -> None:
        self._show(Config(variant=self._variant.value))
        self._hint()

    def _show(self, config: Config) -> None:
        for (variant, method), form in self._forms.items():
            form.show(replace(config, variant=variant).of(method))

    def _arrange(self) -> None:
        """Shows what the chosen variant has."""
        possible = self._possible
        for method, box in self._on.items():
            box.disabled = method not in possible
            box.visible = method != COMPARED or self._variant.value == "modern"
        for (variant, _), folder in self._folders.items():
            folder.visible = variant == self._variant.value
        self._hint()

    def _hint(self) -> None:
        state = self._session.state
        same = self._config == state.config and self._chosen == state.methods
        self._text.content = FRESH if same else PENDING

    def show(self, state: State) -> None:
        if state.run == self._run:
            return
        self._run = state.run
        self._variant.value = state.config.variant
        for method, box in self._on.items():
            box.value = method in state.methods
        self._show(state.config)
        self._arrange()


def _forms() -> list[tuple[Variant, Method]]:
    """Which settings have inputs. The one for comparison shares the paper's."""
    held: dict[Variant, Any] = {"modern": ModernConfig(), "paper": Config()}
    return [(variant, method) for variant in VARIANTS for method in METHODS if hasattr(held[variant], method)]


def _hint(method: Method) -> str:
    if method == COMPARED:
        return "run the paper's integration beside the modern one, with the paper's settings"
    return f"run the {method} method"
