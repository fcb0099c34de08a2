"""viser's side of the page: the panels and the scene, painted from the session's state by a thread of its own."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread

import numpy as np
import rich
import viser

from ispom.geometry import Array
from ispom.types import Sequence, Trajectory

from ...engine.model.drawn_size import drawn_truth
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
from ...features.tracks.scene import LookScene, clicked
from ...features.tracks.tab import NAME, LookTab, looked_at
from ...session import commands as do
from ...session.session import Session
from ...session.state import State
from ..rerun.blueprint import looking_at
from .portless import PortlessViser
from .scene import Scene

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
SCENE_S = 0.25
"""The scene is costlier than the panels, and Rerun shows the same beside it."""
IN_THE_WAY = frozenset({"key_frames", "cameras"})
"""Layers that hide a single fit from who looks at it."""
CLOSELY_S = 1.0
"""Between two drawings of what is looked at closely, while it plays."""


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
        self.server.scene.world_axes.visible = False
        self._scene = Scene(self.server.scene, lambda index: session.post(do.Seek(index)), session.branch)
        self._closely, self._closely_shown, self._closely_due_s = LookScene(self.server.scene), (), 0.0
        self.server.scene.on_click()(self._clicked)
        self._run, self._painted, self._due_s, self._scene_due_s = -1, None, 0.0, 0.0
        self._fault = ""
        self._looked_at: Sequence | None = None
        self._scene_shown: tuple[object, ...] = ()
        """What the scene was drawn from."""
        self.scene_wanted = True
        self._look_wanted = False
        self._stop = Event()
        self._thread = Thread(target=self._paint_on, name="screen", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def show_scene(self, wanted: bool) -> None:
        """Whether anybody can see the scene."""
        self.scene_wanted = wanted

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
            self._steps = IntegrationPanel(gui, self._session, self._aim)
            view = ViewPanel(gui, self._session)
        with tabs.add_tab("Record"):
            record = RecordPanel(gui, self._session)
            bookmarks = BookmarksPanel(gui, self._session)
        learn = learn or self._learn_panel(gui, tabs)
        of_branches: list[Panel] = [branches, curves, differences, flicker, sweep, effect]
        of_views: list[Panel] = [self._steps, view, record, bookmarks, learn]
        return [run, source, explain, self._look, methods, *of_branches, break_point, *of_views]

    def _learn_panel(self, gui: viser.GuiApi, tabs: viser.GuiTabGroupHandle) -> LearnPanel:
        with tabs.add_tab(LEARN):
            return LearnPanel(gui, self._session)

    def _cover(self, covers: bool) -> None:
        """What gives the answer to an open question is out of sight."""
        for handle in self._covered:
            if handle.visible == covers:
                handle.visible = not covers

    def _look_at(self, truth: Trajectory | None) -> None:
        self._aim(*looking_at(truth))

    def _aim(self, position: Array, target: Array) -> None:
        """The cameras of all who are there, and of who comes."""
        self.server.initial_camera.up = (0.0, -1.0, 0.0)
        for camera in (self.server.initial_camera, *(c.camera for c in self.server.get_clients().values())):
            camera.position, camera.look_at = tuple(position), tuple(target)

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
        """Brings the panels and, less often, the scene up to date."""
        state = self._session.state
        if state is not self._painted and (not state.playing or time.monotonic() >= self._due_s):
            self._painted, self._due_s = state, time.monotonic() + PLAYING_S
            seen = covered(state)
            self._cover(seen is not state)
            for panel in self.panels:
                panel.show(seen)
        if self._look_wanted and covered(state) is state:
            self._look.refresh(state)
        self._scene.turn(state.flicker)
        if not self.scene_wanted or time.monotonic() < self._scene_due_s:
            return
        self._scene_due_s = time.monotonic() + SCENE_S
        opened = self._session.opened
        if state.run != self._run and opened is not None:
            self._run = state.run
            self._scene.start(opened)
            self._closely, self._closely_shown = LookScene(self.server.scene), ()
            if opened.sequence is not self._looked_at:  # of another branch, the person's view stays
                self._looked_at = opened.sequence
                self._look_at(drawn_truth(opened.truth, opened.methods))
        drawn = tuple(branch.number for branch in state.branches if not branch.hidden)
        beside = (state.flicker and (state.flicker.a, state.flicker.b), state.integration)
        shown = (state.displayed, state.computed, state.hidden, drawn, beside)
        if state.displayed is not None and shown != self._scene_shown:
            self._scene_shown = shown
            alone = state.flicker is not None
            hidden = state.hidden | frozenset(state.methods if alone else ())
            hidden |= IN_THE_WAY if state.integration is not None else frozenset()
            self._scene.show(self._session.known_at(state.index), state.displayed, hidden)
            self._scene.show_beside({} if alone else self._session.beside(state), hidden)
            self._scene.show_flicker(state.flicker, state.index, state.hidden)
            stage = state.integration.stage if state.integration is not None else 0
            self._scene.show_integration(self._steps.fit if state.integration is not None else None, stage)
        self._show_closely(state)

    def _show_closely(self, state: State) -> None:
        """The selected track, triple and pair in the scene: while the run plays once a second, for they take long."""
        geometry = state.look == "geometry"
        shown = (state.run, state.displayed, state.selected, geometry)
        if shown == self._closely_shown or (state.playing and time.monotonic() < self._closely_due_s):
            return
        self._closely_shown, self._closely_due_s = shown, time.monotonic() + CLOSELY_S
        looked = looked_at(self._session, state) if state.selected or geometry else None
        self._closely.show(looked, geometry)

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        """Selects the track whose point was clicked."""
        looked = looked_at(self._session, self._session.state)
        if looked is not None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            found = clicked(looked, looked.known_at(looked.record.index), *ray)
            if found is not None:
                self._session.post(do.Select(str(found)))
