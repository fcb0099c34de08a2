"""Play, step and speed, above the tabs of the controls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from ...session import commands as do
from ...session.commands import PageCommand
from ...session.state import State
from ...views.viser.panels import Panel

if TYPE_CHECKING:
    from ...session.session import Session

MOVES: dict[str, PageCommand] = {
    "First": do.Seek(0),
    "◀ Step": do.StepBy(-1),
    "Step ▶": do.StepBy(1),
    "Newest": do.GoToEnd(),
}
SPEEDS: dict[str, float | None] = {
    "as fast as possible": None,
    "4 ×": 4.0,
    "2 ×": 2.0,
    "1 ×": 1.0,
    "0.5 ×": 0.5,
    "0.2 ×": 0.2,
}
OTHER = "other"
"""A speed that somebody gave otherwise."""


class TransportPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self.folder = gui.add_folder("Playback")
        with self.folder:
            self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Plays or pauses. Key: Space")
            self._play.on_click(lambda _: session.post(do.Play()))
            self._moves = gui.add_button_group("frame", tuple(MOVES), hint="Pauses, and shows another frame.")
            self._moves.on_click(lambda _: session.post(MOVES[self._moves.value]))
            self._speed = gui.add_dropdown(
                "speed", (*SPEEDS, OTHER), initial_value="1 ×", hint="Playback speed relative to the recording."
            )
            self._speed.on_update(lambda _: self._chosen())

    def show(self, state: State) -> None:
        label = "Pause" if state.playing else "Play"
        if self._play.label != label:
            self._play.label = label
            self._play.icon = viser.Icon.PLAYER_PAUSE if state.playing else viser.Icon.PLAYER_PLAY
        name = next((name for name, factor in SPEEDS.items() if factor == state.speed), OTHER)
        if self._speed.value != name:
            self._speed.value = name

    def _chosen(self) -> None:
        name = self._speed.value
        if name in SPEEDS and SPEEDS[name] != self._session.state.speed:
            self._session.post(do.Speed(SPEEDS[name]))


PANELS = (Panel("", 5, TransportPanel),)
