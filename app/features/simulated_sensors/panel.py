"""What the sensors of a simulation get wrong: a form for each of them, and the branch that runs with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import viser

from ...session.state import State
from ...views.viser.controls import ConfigForm
from ...views.viser.panels import Panel
from .commands import RunWithSensors, simulated_sensors

if TYPE_CHECKING:
    from ...session.session import Session

TITLE, RUN, RESET = "Simulated sensors", "Run as a branch", "As opened"
RUN_HINT = "Runs from the first frame with sensors that err as above: outage, slip, late clock, lever arm, noise."
RESET_HINT = "Puts all sensors back to what the address of the source says."


class SensorPanel:
    """Its forms are made when a source with simulated sensors is opened: others have none."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._gui, self._session, self._source = gui, session, ""
        self._folder = gui.add_folder(TITLE, expand_by_default=False, visible=False)
        self._made: list[Any] = []
        self._forms: list[ConfigForm] = []

    def show(self, state: State) -> None:
        if state.source == self._source:
            return
        self._source, sensors = state.source, simulated_sensors(state.source)
        for handle in self._made:
            handle.remove()
        self._made, self._forms = [], []
        self._folder.visible = bool(sensors)
        if not sensors:
            return
        with self._folder:
            for sensor in sensors:
                folder = self._gui.add_folder(sensor.name, expand_by_default=False)
                with folder:
                    self._forms.append(ConfigForm(self._gui, sensor))
                self._made.append(folder)
            run = self._gui.add_button(RUN, icon=viser.Icon.GIT_FORK, hint=RUN_HINT)
            run.on_click(lambda _: self._session.post(RunWithSensors(tuple(form.value for form in self._forms))))
            reset = self._gui.add_button(RESET, icon=viser.Icon.RESTORE, color="gray", hint=RESET_HINT)
            reset.on_click(lambda _: self._reset())
        self._made += [run, reset]

    def _reset(self) -> None:
        for form, sensor in zip(self._forms, simulated_sensors(self._source), strict=True):
            form.show(sensor)


PANELS = (Panel("Branches", 460, SensorPanel),)
