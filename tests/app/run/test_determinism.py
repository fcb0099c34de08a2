"""The same trajectories, bit for bit: twice without a window, and in the app, however a person plays with it."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.events import Finished, Opened, Stepped
from ispom_app.engine.history.history import History
from ispom_app.engine.playback import Playback
from ispom_app.features.recording.commands import Record
from ispom_app.session import commands as do
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup

from ispom.io.trajectories import tum_text
from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Sequence
from tests.alone import METHODS
from tests.app.helpers import wait_for


class Viewer:
    """Takes all that a browser would be sent."""

    def __init__(self) -> None:
        self.finished: Finished | None = None

    def open(self, opened: Opened, history: History, beginning: Path | None = None) -> None:
        self.opened = opened

    def look_at(self, index: int) -> None: ...

    def check(self) -> None: ...

    def write(self, event: Stepped | Finished) -> None:
        if isinstance(event, Finished):
            self.finished = event


def texts(finished: Finished) -> dict[str, str]:
    return {method: tum_text(trajectory) for method, trajectory in finished.trajectories.items()}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return open_simulated("tiny", cache_dir=tmp_path_factory.mktemp("rendered"), duration_s=0.8)


@pytest.fixture(scope="module")
def headless(flight: Sequence) -> dict[str, str]:
    playback = Playback(flight, METHODS)
    while not playback.done:
        playback.step()
    return texts(playback.finish())


def test_without_a_window_twice(flight: Sequence, headless: dict[str, str]) -> None:
    playback = Playback(flight, METHODS)
    while not playback.done:
        playback.step()
    assert texts(playback.finish()) == headless
    assert all(headless.values())


def test_in_the_app_with_a_viewer_a_recording_and_a_restless_person(
    flight: Sequence, headless: dict[str, str], tmp_path: Path
) -> None:
    viewer = Viewer()
    session = Session(SessionSetup(lambda _: flight, "flight", tmp_path, autoplay=False), viewer)
    session.start()
    try:
        wait_for(lambda: session.state.phase == "ready", "opening")
        for command in (do.Speed(None), Record("while"), do.Seek(9), do.Seek(3), do.StepBy(1), do.Play(True)):
            session.post(command)
        wait_for(lambda: viewer.finished is not None, "the end", 60)
        assert viewer.finished is not None
        assert texts(viewer.finished) == headless
    finally:
        assert session.close(20.0)
