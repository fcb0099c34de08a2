"""Controls of panels as a user has them, without a browser; and the one place of tests that names viser's own parts.

What viser does not offer publicly stands at the end, so that another version of it changes this file alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser


class Gui:
    """Stands in for `server.gui` while a panel is made: hands each call on, and remembers the controls.

    A test finds a control by its label, as a user does, and need not know under which name the panel keeps it.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._of = server.gui
        self._made: list[tuple[str, Any]] = []

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._of, name)
        return self._remembering(name.removeprefix("add_"), found) if name.startswith("add_") else found

    def _remembering(self, kind: str, add: Callable[..., Any]) -> Callable[..., Any]:
        def added(*words: Any, **options: Any) -> Any:
            control = add(*words, **options)
            self._made.append((kind, control))
            return control

        return added

    def every(self, kind: str) -> list[Any]:
        """All of a kind, such as `checkbox`, in the order in which they were made."""
        return [control for made_as, control in self._made if made_as == kind]

    def labelled(self, label: str, kind: str = "") -> Any:
        """The one control with that label now, of that kind if one is named; visible or not."""
        (found,) = [c for made_as, c in self._made if kind in ("", made_as) and getattr(c, "label", None) == label]
        return found

    def folder(self, beginning: str) -> tuple[Any, dict[str, Any]]:
        """The folder whose label begins so, and by their labels the controls made after it and before the next."""
        places = [i for i, (kind, _) in enumerate(self._made) if kind == "folder"]
        (at,) = [i for i in places if self._made[i][1].label.startswith(beginning)]
        end = next((i for i in places if i > at), len(self._made))
        return self._made[at][1], {c.label: c for _, c in self._made[at + 1 : end] if hasattr(c, "label")}

    @property
    def text(self) -> str:
        """What its visible texts say, as HTML or Markdown."""
        texts = [*self.every("html"), *self.every("markdown")]
        return "\n".join(text.content for text in texts if text.visible)


def text_of(panel: Callable[[Any, Any], object], server: viser.ViserServer, session: Any) -> str:
    """What a panel of a session says when it is made."""
    gui = Gui(server)
    panel(gui, session)
    return gui.text


def press(button: viser.GuiButtonHandle) -> None:
    """As a click does, in this thread."""
    button.value = True


def inputs_of(server: viser.ViserServer) -> list[Any]:
    """All controls that have a value, whoever made them."""
    return list(server.gui._gui_input_handle_from_uuid.values())


def uuid_of(control: Any) -> str:
    """The name by which messages of a browser mean this control."""
    return control._impl.uuid


def has_pages(server: viser.ViserServer) -> bool:
    """Checks that a connection of some page is open; `get_clients` knows only those that have sent a camera."""
    return bool(server._websock_server._live_connections)


def understood_messages(server: viser.ViserServer) -> set[str]:
    """The kinds of messages of a page that something is done about."""
    return {kind.__name__ for kind in server._websock_server._incoming_handlers}


def work_off(server: viser.ViserServer) -> None:
    """Returns when viser has done what its messages until now have asked for."""
    server._thread_executor.submit(lambda: None).result(10)
