"""viser's side of the page: the panels. A thread paints them from the session's state."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread

import rich
import viser

from ...session import commands as do
from ...session.actions import Action, actions
from ...session.session import Session
from ...session.state import covered
from .panels import PanelView, panels
from .portless import PortlessViser

log = logging.getLogger(__name__)
NOTICE_S = 6.0
"""Time for which the notice that no source is open is shown, as in the page (notices.js)."""
PAINT_S = 1 / 30
PLAYING_S = 0.1
"""Interval between two updates of the panels during playing: for each, the browser draws the whole page."""


class Screen:
    """The viser server, and the thread that keeps it up to date."""

    def __init__(self, session: Session) -> None:
        self._session = session
        rich.get_console().quiet = True  # viser's banner names a port that does not exist
        self.viser = PortlessViser("ISPOM")
        self.server = self.viser.server
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(52, 148, 208))
        self.server.gui.main_panel.dock_left()
        self.server.gui.main_panel.set_width(380)
        self.panels: list[PanelView] = []
        self._by_tab: dict[str, list[PanelView]] = {}
        self._open_tabs = frozenset[str]()
        self._tabs = self._add_panels(self.server.gui)
        self._commands = [self._add_action(self.server.gui, action) for action in actions()]
        self._state, self._due_s = None, 0.0
        self._stale: set[str] = set()
        """Tabs that do not show the newest state."""
        self._fault = ""
        self._stop = Event()
        self._thread = Thread(target=self._paint_on, name="screen", daemon=True)

    def start(self) -> None:
        self._thread.start()

    @property
    def tabs(self) -> frozenset[str]:
        """Returns the names of all tabs; the empty name is the area above them."""
        return frozenset(self._by_tab)

    def show_tabs(self, open_tabs: frozenset[str]) -> None:
        """Sets the tabs that any page has open; other tabs are not drawn."""
        self._open_tabs = open_tabs

    def close(self) -> None:
        self._stop.set()
        self._thread.join(1.0)
        self.server.stop()

    def _add_panels(self, gui: viser.GuiApi) -> viser.GuiTabGroupHandle:
        """The panels of all features, those without a tab above the tabs."""
        found = panels()
        for panel in found.pop("", []):
            self.add("", panel.make(gui, self._session))
        tabs = gui.add_tab_group()
        for name, inside in found.items():
            with tabs.add_tab(name):
                for panel in inside:
                    self.add(name, panel.make(gui, self._session))
        return tabs

    def add(self, tab: str, view: PanelView) -> None:
        """Adds a panel to a tab, below the panels that it has."""
        self.panels.append(view)
        self._by_tab.setdefault(tab, []).append(view)

    def _add_action(self, gui: viser.GuiApi, action: Action) -> viser.CommandHandle:
        """Adds an entry to the palette. The page (keyboard.js) handles its key: two handlers would step twice."""
        entry = gui.add_command(action.label, description=f"{action.hint} Key: {action.key}")
        entry.on_trigger(lambda event: self._act(event, action))
        return entry

    def _act(self, event: viser.CommandEvent, action: Action) -> None:
        """Executes an action, except while a source is being opened: there is no run to move in, and a later move would
        be a surprise."""
        if self._session.state.phase != "opening":
            self._session.post(action.command)
        elif event.client is not None:
            text = "The source is still being opened: moves work once it is."
            event.client.add_notification("Not open yet", text, auto_close_seconds=NOTICE_S)

    def _cover(self, covers: bool) -> None:
        """Hides panels that show the answer to an open question."""
        folders = [getattr(view, "folder", self._tabs) for view in self._by_tab.get("", [])]
        for handle in (*folders, self._tabs):
            if handle.visible == covers:
                handle.visible = not covers

    def _paint_on(self) -> None:
        while not self._stop.wait(PAINT_S):
            self.paint_or_report()

    def paint_or_report(self) -> None:
        """Paints the screen. If a part fails, the other parts are painted all the same."""
        try:
            self.paint()
        except Exception as fault:
            self._report(f"{type(fault).__name__}: {fault}")

    def _report(self, fault: str) -> None:
        """Reports a fault once, as long as it stays the same, because parts are painted repeatedly."""
        if fault != self._fault:
            self._fault = fault
            log.exception("painting failed")
            self._session.post(do.Notify(f"Some controls could not be updated ({fault}); the run continues."))

    def paint(self) -> None:
        """Updates the panels that somebody sees."""
        state = self._session.state
        seen, open_tabs = covered(state), [tab for tab in self._by_tab if not tab or tab in self._open_tabs]
        if state is not self._state and (not state.playing or time.monotonic() >= self._due_s):
            self._state, self._due_s = state, time.monotonic() + PLAYING_S
            self._cover(seen is not state)
            self._stale |= self._by_tab.keys()
        for tab in (tab for tab in open_tabs if tab in self._stale):
            self._stale.discard(tab)
            for panel in self._by_tab[tab]:
                panel.show(seen)
        if seen is state:
            for view in (view for tab in open_tabs for view in self._by_tab[tab]):
                if (refresh := getattr(view, "refresh", None)) is not None:
                    refresh(state)
