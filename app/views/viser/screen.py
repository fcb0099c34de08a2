"""viser's side of the page: the panels and the scene, painted from the session's state by a thread of its own."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread

import rich
import viser

from ...features.bookmarks.panel import BookmarksPanel
from ...features.branches.differences import DifferencesPanel
from ...features.branches.error_curves import ErrorCurvesPanel
from ...features.branches.panel import BranchesPanel
from ...features.breakpoints.panel import BreakPointPanel
from ...features.explain.panel import TAB as EXPLAIN
from ...features.explain.panel import ExplainPanel
from ...features.flicker.panel import FlickerPanel
from ...features.integration.panel import IntegrationPanel
from ...features.layers.panel import ViewPanel
from ...features.lessons.learning import covered
from ...features.lessons.panel import NAME as LEARN
from ...features.lessons.panel import LearnPanel
from ...features.methods.panel import MethodsPanel
from ...features.playback.panel import RunPanel
from ...features.recording.panel import RecordPanel
from ...features.sensitivity.panel import EffectPanel
from ...features.sources.panel import SourcePanel
from ...features.sweep.panel import SweepPanel
from ...features.tracks.tab import NAME, LookTab
from ...session import commands as do
from ...session.session import Session
from .portless import PortlessViser

log = logging.getLogger(__name__)
Panel = (
    RunPanel
    | SourcePanel
    | MethodsPanel
    | BranchesPanel
    | DifferencesPanel
    | EffectPanel
    | ErrorCurvesPanel
    | FlickerPanel
    | SweepPanel
    | IntegrationPanel
    | LearnPanel
    | BreakPointPanel
    | ViewPanel
    | ExplainPanel
    | LookTab
    | RecordPanel
    | BookmarksPanel
)
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
        self.panels = self._panels(self.server.gui)
        self._painted, self._due_s = None, 0.0
        self._fault = ""
        self._look_wanted = False
        self._stop = Event()
        self._thread = Thread(target=self._paint_on, name="screen", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def show_tabs(self, open_tabs: frozenset[str]) -> None:
        """Which tabs anybody has open: what takes long is drawn for those only."""
        self._look_wanted = NAME in open_tabs

    def close(self) -> None:
        self._stop.set()
        self._thread.join(1.0)
        self.server.stop()

    def _panels(self, gui: viser.GuiApi) -> list[Panel]:
        run = RunPanel(gui, self._session)
        source = SourcePanel(gui, self._session)
        tabs = gui.add_tab_group()
        self._covered = (source.folder, tabs)
        learn = self._learn_panel(gui, tabs) if self._session.library.leads else None
        with tabs.add_tab(EXPLAIN):
            explain = ExplainPanel(gui, self._session)
        with tabs.add_tab(NAME):
            self._look = LookTab(gui, self._session)
        with tabs.add_tab("Methods"):
            methods = MethodsPanel(gui, self._session)
        with tabs.add_tab("Branches"):
            branches = BranchesPanel(gui, self._session)
            curves = ErrorCurvesPanel(gui, self._session)
            differences = DifferencesPanel(gui, self._session)
            flicker = FlickerPanel(gui, self._session)
            sweep = SweepPanel(gui, self._session)
            effect = EffectPanel(gui, self._session)
        with tabs.add_tab("Break"):
            break_point = BreakPointPanel(gui, self._session)
        with tabs.add_tab("View"):
            integration = IntegrationPanel(gui, self._session)
            view = ViewPanel(gui, self._session)
        with tabs.add_tab("Record"):
            record = RecordPanel(gui, self._session)
            bookmarks = BookmarksPanel(gui, self._session)
        learn = learn or self._learn_panel(gui, tabs)
        of_branches: list[Panel] = [branches, curves, differences, flicker, sweep, effect]
        of_views: list[Panel] = [integration, view, record, bookmarks, learn]
        return [run, source, explain, self._look, methods, *of_branches, break_point, *of_views]

    def _learn_panel(self, gui: viser.GuiApi, tabs: viser.GuiTabGroupHandle) -> LearnPanel:
        with tabs.add_tab(LEARN):
            return LearnPanel(gui, self._session)

    def _cover(self, covers: bool) -> None:
        """What gives the answer to an open question is out of sight."""
        for handle in self._covered:
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
        """Tells of a fault, once as long as it stays the same: what can be painted is painted again and again."""
        if fault != self._fault:
            self._fault = fault
            log.exception("painting failed")
            self._session.post(do.Notify(f"Some controls could not be updated ({fault}); the run continues."))

    def paint(self) -> None:
        """Brings the panels up to date."""
        state = self._session.state
        if state is not self._painted and (not state.playing or time.monotonic() >= self._due_s):
            self._painted, self._due_s = state, time.monotonic() + PLAYING_S
            seen = covered(state)
            self._cover(seen is not state)
            for panel in self.panels:
                panel.show(seen)
        if self._look_wanted and covered(state) is state:
            self._look.refresh(state)
