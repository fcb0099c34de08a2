"""Run: play, step, seek, speed, and what is open."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import viser

from ...session import commands as do
from ...session.state import State

if TYPE_CHECKING:
    from ...session.session import Session

SPEEDS: dict[str, float | None] = {"max": None, "4 x": 4.0, "2 x": 2.0, "1 x": 1.0, "0.5 x": 0.5, "0.2 x": 0.2}
BACK, PLAY, FORWARD = "◀ step", "play / pause", "step ▶"
HAND_S = 0.4
"""How long after a person moved the slider the program leaves it alone."""


class RunPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._shown, self._touched_s = session, -1, 0.0
        self._buttons = gui.add_button_group("", (BACK, PLAY, FORWARD), hint="keys: ← space →")
        self._buttons.on_click(self._clicked)
        self._slider = gui.add_slider("exposure", 0, 1, 1, 0, hint="what is not computed yet is computed up to there")
        self._slider.on_update(self._moved)
        self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1 x", hint="times the recorded time")
        self._speed.on_update(lambda _: session.post(do.Speed(SPEEDS[self._speed.value])))
        self._progress = gui.add_progress_bar(0)
        self._text = gui.add_markdown("opening…")
        with gui.add_folder("Source", expand_by_default=False):
            self._source = gui.add_text(
                "open",
                session.state.source,
                hint="sim:city, sim:city#3 (another seed), or the path of a recording (KITTI, folder of images …)",
            )
            gui.add_button("Open", icon=viser.Icon.FOLDER_OPEN).on_click(self._open)
        self._commands = [
            gui.add_command("Play / pause", hotkey="space", icon=viser.Icon.PLAYER_PLAY),
            gui.add_command("Step forward", hotkey="arrowright", icon=viser.Icon.PLAYER_TRACK_NEXT),
            gui.add_command("Step back", hotkey="arrowleft", icon=viser.Icon.PLAYER_TRACK_PREV),
        ]
        for command, wanted in zip(self._commands, (do.Play(), do.StepBy(1), do.StepBy(-1)), strict=True):
            command.on_trigger(lambda _, wanted=wanted: session.post(wanted))

    def _clicked(self, _: object) -> None:
        self._session.post({BACK: do.StepBy(-1), PLAY: do.Play(), FORWARD: do.StepBy(1)}[self._buttons.value])

    def _moved(self, _: object) -> None:
        if self._slider.value - 1 != self._shown:
            self._touched_s = time.monotonic()
            self._session.post(do.Seek(int(self._slider.value) - 1))

    def _open(self, _: object) -> None:
        self._session.post(do.Open(self._source.value.strip()))

    def show(self, state: State) -> None:
        self._slider.disabled = state.total < 2
        if state.total and self._slider.max != state.total:
            self._shown = 0
            self._slider.min, self._slider.max, self._slider.value = 1, state.total, 1
        if state.index >= 0 and time.monotonic() - self._touched_s > HAND_S and self._slider.value != state.index + 1:
            self._shown = state.index
            self._slider.value = state.index + 1
        self._progress.value = round(100 * state.computed / max(state.total, 1), 1)
        if (text := _text(state)) != self._text.content:
            self._text.content = text


def _text(state: State) -> str:
    if state.phase == "opening" and not state.total:
        return f"Opening **{state.source}** …"
    if state.phase == "failed":
        return "Nothing is open. Type a source below, `sim:city` or a path, and press Open."
    waiting = f"computing up to {state.target + 1} · " if state.target is not None else ""
    lines = [f"{waiting}computed {state.computed} of {state.total} exposures" + (" · finished" if state.ended else "")]
    return "\n\n".join([*lines, *(f"*{note}*" for note in state.notes)])
