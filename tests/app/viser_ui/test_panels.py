"""The panels, on viser without a browser: what they show of a state, and what they ask of the session."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.features.recording.commands import Record
from ispom_app.features.recording.panel import STOP, RecordPanel
from ispom_app.features.recording.state import Recording, Recordings
from ispom_app.session import commands as do
from ispom_app.session.sources.folders import Folders
from ispom_app.session.state import State

from tests.app.gui import Gui, press

HOSTILE = '<iframe srcdoc="<script>parent.hit = 1</script>"></iframe>'
STATE = State("double:20", phase="ready", name="double", run=1, total=20, methods=("stereo",))


@pytest.fixture
def gui(server: viser.ViserServer) -> Any:
    return Gui(server)


@pytest.fixture
def session(tmp_path: Path) -> Any:
    commands: list[do.Command] = []
    return SimpleNamespace(
        state=STATE, opened=None, run=None, post=commands.append, asked=commands, folders=Folders(tmp_path)
    )


def test_names_of_recordings_are_never_markup(gui, session):
    panel = RecordPanel(gui, session)
    panel.show(STATE.having(Recordings(Recording(HOSTILE, 0, 0))))
    assert "<iframe" not in gui.text and gui.labelled("name").disabled
    press(gui.labelled(STOP))
    assert session.asked == [Record("")]
