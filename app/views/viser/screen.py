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
from ...features.branches.beside import branches_beside
from ...features.branches.service import BranchService
from ...features.branches.state import Branches
from ...features.flicker.state import Flickering
from ...features.integration.panel import IntegrationPanel
from ...features.integration.state import IntegrationSteps
from ...features.layers.state import Layers
from ...features.lessons.state import covered
from ...features.tracks.commands import Select
from ...features.tracks.scene import LookScene, clicked
from ...features.tracks.state import Inspection
from ...features.tracks.tab import looked_at
from ...session import commands as do
from ...session.actions import Action, actions
from ...session.session import Session
from ...session.state import State
from ..rerun.blueprint import looking_at
from .panels import PanelView, panels
from .portless import PortlessViser
from .scene import Scene

log = logging.getLogger(__name__)
NOTICE_S = 6.0
"""How long the sentence that nothing is open yet stays, as in the page (notices.js)."""
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
        self.panels: list[PanelView] = []
        self._by_tab: dict[str, list[PanelView]] = {}
        self._open_tabs = frozenset[str]()
        self._tabs = self._add_panels(self.server.gui)
        self._commands = [self._add_action(self.server.gui, action) for action in actions()]
        self.server.scene.world_axes.visible = False
        self._scene = Scene(
            self.server.scene, lambda index: session.post(do.Seek(index)), session.service(BranchService).run_of
        )
        self._closely, self._closely_shown, self._closely_due_s = LookScene(self.server.scene), (), 0.0
        self.server.scene.on_click()(self._clicked)
        self._run, self._painted, self._due_s, self._scene_due_s = -1, None, 0.0, 0.0
        self._fault = ""
        self._looked_at: Sequence | None = None
        self._scene_shown: tuple[object, ...] = ()
        """What the scene was drawn from."""
        self.scene_wanted = True
        self._stop = Event()
        self._thread = Thread(target=self._paint_on, name="screen", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def show_scene(self, wanted: bool) -> None:
        """Whether anybody can see the scene."""
        self.scene_wanted = wanted

    def show_tabs(self, open_tabs: frozenset[str]) -> None:
        """Which tabs anybody has open: what takes long is drawn for those only."""
        self._open_tabs = open_tabs

    def close(self) -> None:
        self._stop.set()
        self._thread.join(1.0)
        self.server.stop()

    def _add_panels(self, gui: viser.GuiApi) -> viser.GuiTabGroupHandle:
        """The panels of all features, those without a tab above the tabs."""
        found = panels(self._session)
        for panel in found.pop("", []):
            self._add("", panel.make(gui, self._session))
        tabs = gui.add_tab_group()
        for name, inside in found.items():
            with tabs.add_tab(name):
                for panel in inside:
                    self._add(name, panel.make(gui, self._session))
        return tabs

    def _add(self, tab: str, view: PanelView) -> None:
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
        """What gives the answer to an open question is out of sight."""
        folders = [getattr(view, "folder", self._tabs) for view in self._by_tab.get("", [])]
        for handle in (*folders, self._tabs):
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
        if covered(state) is state:
            for view in (view for tab in self._open_tabs for view in self._by_tab.get(tab, [])):
                if (refresh := getattr(view, "refresh", None)) is not None:
                    refresh(state)
        self._scene.turn(state[Flickering].between)
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
        drawn = tuple(branch.number for branch in state[Branches].all if not branch.hidden)
        flicker, steps = state[Flickering].between, state[IntegrationSteps].shown
        beside = (flicker and (flicker.a, flicker.b), steps)
        shown = (state.displayed, state.computed, state[Layers].hidden, drawn, beside)
        if state.displayed is not None and shown != self._scene_shown:
            self._scene_shown = shown
            alone = flicker is not None
            hidden = state[Layers].hidden | frozenset(state.methods if alone else ())
            hidden |= IN_THE_WAY if steps is not None else frozenset()
            self._scene.show(self._session.known_at(state.index), state.displayed, hidden)
            self._scene.show_beside({} if alone else branches_beside(self._session, state), hidden)
            self._scene.show_flicker(flicker, state.index, state[Layers].hidden)
            fit = next((view.fit for view in self.panels if isinstance(view, IntegrationPanel)), None)
            self._scene.show_integration(fit if steps is not None else None, steps.stage if steps is not None else 0)
        self._show_closely(state)

    def _show_closely(self, state: State) -> None:
        """The selected track, triple and pair in the scene: while the run plays once a second, for they take long."""
        geometry = state[Inspection].panel == "geometry"
        shown = (state.run, state.displayed, state[Inspection].selected, geometry)
        if shown == self._closely_shown or (state.playing and time.monotonic() < self._closely_due_s):
            return
        self._closely_shown, self._closely_due_s = shown, time.monotonic() + CLOSELY_S
        looked = looked_at(self._session, state) if state[Inspection].selected or geometry else None
        self._closely.show(looked, geometry)

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        """Selects the track whose point was clicked."""
        looked = looked_at(self._session, self._session.state)
        if looked is not None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            found = clicked(looked, looked.known_at(looked.record.index), *ray)
            if found is not None:
                self._session.post(Select(str(found)))
