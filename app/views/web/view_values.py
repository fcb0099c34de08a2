"""View values: what a feature shows of a frame, as a typed value that a component of the page draws.

A feature has them in `features/NAME/view.py`, in `VIEWS`, and `features/NAME/panel.js` exports a component of the same
name. It is drawn in a tab of the left pane, or in a place of the page of its own. The page's types are written from
them: `python -m tests.app.view_types`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from ...session import commands as do
from ...session.current_run import CurrentRun
from ...session.registry import modules
from ...session.state import State, covered
from .news import Look, News

log = logging.getLogger(__name__)
SCRIPT = "panel.js"


@dataclass(frozen=True)
class View:
    name: str
    """Of the component."""
    tab: str
    """Of the page's left pane; or, with a # before it, the id of the page's element that it has for itself."""
    place: int
    """Tabs, and views in a tab, are in the order of their places."""
    of: Callable[[State, CurrentRun | None, int], msgspec.Struct]
    """Pure: the value for a state, the run (None where there is none, or a question covers it), and the frame."""


def views() -> list[View]:
    """Those of all features, in the order of their places."""
    found = (view for module in modules("view") for view in module.VIEWS)
    return sorted(found, key=lambda view: view.place)


def scripts() -> dict[str, Path]:
    """The file with the components of each feature that has some, by the name that addresses have of it."""
    folders = (Path(str(module.__file__)).parent for module in modules("view"))
    return {f"{folder.name}.js": folder / SCRIPT for folder in folders}


def listed() -> list[dict[str, str]]:
    """What a page needs to know of each view, in their order: its name, its tab, and its script."""
    by_view = {view.name: module.__name__.split(".")[-2] for module in modules("view") for view in module.VIEWS}
    return [{"name": view.name, "tab": view.tab, "script": f"{by_view[view.name]}.js"} for view in views()]


def value_of(view: View, state: State, run: CurrentRun | None) -> dict[str, Any]:
    """The value as JSON, by field. While a question is open, nothing in it gives the answer away."""
    found = view.of(covered(state), None if state.covers else run, state.index)
    return msgspec.to_builtins(found, enc_hook=_plain)


def _plain(value: object) -> str:
    """The text of a kind of text, as a doubt about a source is one. NotImplementedError for all else."""
    if isinstance(value, str):
        return str(value)
    raise NotImplementedError(f"a view value holds a {type(value).__name__}")


class ViewNews(News):
    """What one page has of the view values: a field is sent again when it has changed."""

    def __init__(self) -> None:
        self._views = views()
        self._sent: dict[str, dict[str, Any]] = {}
        self._fault = ""

    def of(self, look: Look) -> dict[str, Any]:
        news = {} if self._sent else {"panels": listed()}
        changed = {}
        for view in self._views:
            before = self._sent.get(view.name, {})
            now = self._value(view, look, before)
            if found := {key: value for key, value in now.items() if key not in before or before[key] != value}:
                changed[view.name] = found
            self._sent[view.name] = now
        return news | ({"views": changed} if changed else {})

    def _value(self, view: View, look: Look, before: dict[str, Any]) -> dict[str, Any]:
        """A view that fails costs that view, and not the page; that is reported once as long as it stays the same."""
        try:
            return value_of(view, look.local, look.run)
        except Exception as fault:
            text = f"{view.tab}: {type(fault).__name__}: {fault}"
            if text != self._fault:
                self._fault = text
                log.exception("the view %s failed", view.name)
                look.session.post(do.Notify(f"A part of the page could not be updated ({text}); the run continues."))
            return before
