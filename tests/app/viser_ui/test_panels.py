"""The panels, on viser without a browser: what they show of a state, and what they ask of the session."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.features.recording.commands import Record
from ispom_app.features.recording.panel import RecordPanel
from ispom_app.features.recording.state import Recording, Recordings
from ispom_app.session import commands as do
from ispom_app.session.sources.folders import Folders
from ispom_app.session.state import State

from ispom.types import Decision, Status, Step

HOSTILE = '<iframe srcdoc="<script>parent.hit = 1</script>"></iframe>'
STATE = State("double:20", phase="ready", name="double", run=1, total=20, methods=("stereo",))


@pytest.fixture(scope="module")
def gui(server: viser.ViserServer) -> viser.GuiApi:
    return server.gui


@pytest.fixture
def session(tmp_path: Path) -> Any:
    commands: list[do.Command] = []
    return SimpleNamespace(
        state=STATE, opened=None, run=None, post=commands.append, asked=commands, folders=Folders(tmp_path)
    )


def record(index: int, *decisions: Decision) -> ExposureRecord:
    step = Step(0, Status.TRACKING, decisions=decisions, seconds={"track": 0.004}, method="stereo")
    return ExposureRecord(index, 0, "stereo", (step,), {}, {}, {})


def by_hand(handle: Any, value: Any) -> None:
    """As a message of a browser."""
    handle._impl.value = value
    for callback in handle._impl.update_cb:
        callback(SimpleNamespace(client_id=1))


def press(handle: Any) -> None:
    for callback in handle._impl.update_cb:
        callback(SimpleNamespace())


def test_names_of_recordings_are_never_markup(gui, session):
    panel = RecordPanel(gui, session)
    panel.show(STATE.having(Recordings(Recording(HOSTILE, 0, 0))))
    assert "<iframe" not in panel._text.content and panel._name.disabled
    press(panel._button)
    assert session.asked == [Record("")]
