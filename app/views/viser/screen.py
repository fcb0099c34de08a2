"""viser's side of the page: the panels, painted from the session's state by a thread of its own."""

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
"""How long the sentence that nothing is open yet stays, as in the page (notices.js)."""
PAINT_S = 1 / 30
PLAYING_S = 0.1
"""Between two pictures of the panels while it plays: each is a new picture of the whole page to the browser."""


class Screen:
    """The viser server, and the thread that keeps it up to date."""

    def __init__(self, session: Session) -> None:
        self._session = session
        rich.get_console().quiet = True  # viser's banner names a port that is nobody's business
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
        """Names of all tabs; the empty one is what stands above them."""
        return frozenset(self._by_tab)

    def show_tabs(self, open_tabs: frozenset[str]) -> None:
        """Which tabs anybody has open: what nobody sees is not drawn."""
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
        """A panel is shown in this tab, below those that are there."""
        self.panels.append(view)
        self._by_tab.setdefault(tab, []).append(view)

    def _add_action(self, gui: viser.GuiApi, action: Action) -> viser.CommandHandle:
        """An entry of the palette. Its key is the page's (keyboard.js): two that listen would step twice."""
        entry = gui.add_command(action.label, description=f"{action.hint} Key: {action.key}")
        entry.on_trigger(lambda event: self._act(event, action))
        return entry

    def _act(self, event: viser.CommandEvent, action: Action) -> None:
        """While a source is being opened there is nothing to move in yet; later it would come as a surprise."""
        if self._session.state.phase != "opening":
            self._session.post(action.command)
        elif event.client is not None:
            text = "The source is still being opened: moves work once it is."
            event.client.add_notification("Not open yet", text, auto_close_seconds=NOTICE_S)

    def _cover(self, covers: bool) -> None:
        """Hides what gives the answer to an open question."""
        folders = [getattr(view, "folder", self._tabs) for view in self._by_tab.get("", [])]
        for handle in (*folders, self._tabs):
            if handle.visible == covers:
                handle.visible = not covers

    def _paint_on(self) -> None:
        while not self._stop.wait(PAINT_S):
            self.paint_or_report()

    def paint_or_report(self) -> None:
        """A part that cannot be painted costs that part, not the screen."""
        try:
            self.paint()
        except Exception as fault:
            self._report(f"{type(fault).__name__}: {fault}")

    def _report(self, fault: str) -> None:
        """Reports a fault, once as long as it stays the same: what can be painted is painted again and again."""
        if fault != self._fault:
            self._fault = fault
            log.exception("painting failed")
            self._session.post(do.Notify(f"Some controls could not be updated ({fault}); the run continues."))

    def paint(self) -> None:
        """Brings the panels up to date that somebody sees."""
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
