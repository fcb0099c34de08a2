"""Run: play, step, seek and speed."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import viser

from ...session import commands as do
from ...session.actions import ACTIONS, BY_NAME
from ...session.state import Loop, State
from ...views.viser.markup import renderer

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

SPEEDS: dict[str, float | None] = {"max": None, "4 x": 4.0, "2 x": 2.0, "1 x": 1.0, "0.5 x": 0.5, "0.2 x": 0.2}
BACK, PLAY, PAUSE, FORWARD = "◀ Step", "▶ Play", "‖ Pause", "Step ▶"
MOVES = {
    "key frame": {"◀": "key_frame_back", "▶": "key_frame"},
    "stereo": {"◀": "stereo_back", "▶": "stereo"},
    "go to": {"Start": "start", "End": "end"},
    "loop": {"From here": "loop_start", "To here": "loop_end", "Off": "no_loop"},
}
"""Rows of buttons: what is on each, and the action's name."""
HAND_S = 0.4
"""How long after a person moved the slider the program leaves it alone."""
NOTICE_S = 6.0
"""How long the sentence that nothing is open yet stays, as in the page (notices.js)."""


class RunPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._touched_s = session, 0.0
        self._buttons = gui.add_button_group("", (BACK, PLAY, FORWARD), hint="Keys: ← space →")
        self._buttons.on_click(self._clicked)
        hint = "Counted from 0. An exposure that is not computed yet is computed first."
        self._slider = gui.add_slider("exposure", 0, 1, 1, 0, hint=hint)
        self._slider.on_update(self._moved)
        hint = "Relative to the recording; max: as fast as it can be computed."
        self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1 x", hint=hint)
        self._speed.on_update(lambda _: session.post(do.Speed(SPEEDS[self._speed.value])))
        self._progress = gui.add_progress_bar(0)
        self._text = gui.add_html(_text(session.state))
        with gui.add_folder("Moves and loop", expand_by_default=False):
            self._moves = {label: _buttons(gui, session, label, names) for label, names in MOVES.items()}
        # Their keys are the page's (keyboard.js): two that listen would step twice.
        self._commands: list[viser.CommandHandle] = []
        for action in ACTIONS:
            entry = gui.add_command(action.label, description=f"{action.hint} Key: {action.key}")
            entry.on_trigger(lambda event, wanted=action.command: _move(session, event, wanted))
            self._commands.append(entry)

    def _clicked(self, event: viser.GuiEvent[Any]) -> None:
        commands = {BACK: do.StepBy(-1), PLAY: do.Play(True), PAUSE: do.Play(False), FORWARD: do.StepBy(1)}
        _move(self._session, event, commands[self._buttons.value])

    def _moved(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is not None:  # else the program moved it
            self._touched_s = time.monotonic()
            _move(self._session, event, do.Seek(int(self._slider.value)))

    def show(self, state: State) -> None:
        buttons = (BACK, PAUSE if state.playing else PLAY, FORWARD)
        if self._buttons.options != buttons:
            self._buttons.options = buttons
        self._slider.disabled = state.total < 2
        last = max(state.total - 1, 1)
        if self._slider.max != last:
            if self._slider.value > last:  # another, shorter source
                self._slider.value = 0
            self._slider.max = last
        touched = time.monotonic() - self._touched_s < HAND_S
        if state.index >= 0 and not touched and self._slider.value != state.index:
            self._slider.value = state.index
        self._progress.value = round(100 * state.computed / max(state.total, 1), 1)
        opened = self._session.opened
        stereo = opened is None or opened.sequence.rig.has_stereo
        if self._moves["stereo"].visible != stereo:
            self._moves["stereo"].visible = stereo
        if (text := _text(state)) != self._text.content:
            self._text.content = text


def _buttons(gui: viser.GuiApi, session: Session, label: str, names: dict[str, str]) -> viser.GuiButtonGroupHandle:
    hint = " ".join(f"{text}: {BY_NAME[name].hint} Key: {BY_NAME[name].key}." for text, name in names.items())
    found = gui.add_button_group(label, tuple(names), hint=hint)
    found.on_click(lambda event: _move(session, event, BY_NAME[names[found.value]].command))
    return found


def _move(session: Session, event: viser.GuiEvent[Any] | viser.CommandEvent, wanted: do.Command) -> None:
    """Of a source that is still being opened there is nothing to move in yet; later it would come as a surprise."""
    if session.state.phase != "opening":
        session.post(wanted)
    elif event.client is not None:
        text = "The source is still being opened: moves work once it is."
        event.client.add_notification("Not open yet", text, auto_close_seconds=NOTICE_S)


def _text(state: State) -> str:
    """What is known of the run, as HTML."""
    if state.phase == "opening" and not state.total:
        return render("run.html", text=f"Opening {state.source} …", notes=())
    if state.phase == "failed":
        text = "Nothing is open. Choose a source below, sim:city or a path, and press Open."
        return render("run.html", text=text, notes=(state.failure,))
    waiting = f"computing up to {state.target} · " if state.target is not None else ""
    finished = " · finished" if state.ended else ""
    loop = f" · loop {state.loop.start} to {_end(state.loop)}" if state.loop is not None else ""
    text = f"{waiting}computed {state.computed} of {state.total} exposures{finished}{loop}"
    return render("run.html", text=text, notes=state.notes)


def _end(loop: Loop) -> str:
    return "the end" if loop.end is None else str(loop.end)
