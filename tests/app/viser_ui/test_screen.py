"""The screen: what it paints of a state, when, and what becomes of it where a panel fails. No thread, no browser."""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.engine.playback import Playback
from ispom_app.features.lessons.library import Library
from ispom_app.features.recording.state import Recording
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.sources.folders import Folders
from ispom_app.session.state import Computed, Displayed, State, reduce
from ispom_app.views.viser import screen as screens
from ispom_app.views.viser.screen import Screen

from tests import doubles
from tests.alone import METHODS
from tests.app.gui import Gui
from tests.app.helpers import build_full, run_to_end, with_values

N = 40


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    """Every estimator says all that a Step can say."""
    return run_to_end(Playback(doubles.sequence(N), METHODS, builder=build_full))


class FakeSession:
    """Is at one frame of a run that was computed before."""

    def __init__(self, run: CurrentRun, folder: Path) -> None:
        self._run, self.asked = run, list[do.Command]()
        self.run = run
        self.opened, self.folders, self.post = run.opened, Folders(folder), self.asked.append
        self._library = Library()
        self.known_at = run.known_at
        self.series = run.series
        self.state = reduce(State("double:40"), run.opened)
        for record in run.history:
            self.state = reduce(self.state, Computed(record, run.tally))

    def extra(self, kind: type) -> Any:
        return self._library

    def service(self, kind: type) -> Any:
        return SimpleNamespace(run_of=lambda number: self._run)

    def becomes(self, **values: object) -> None:
        self.state = with_values(self.state, **values)

    def seek(self, index: int) -> None:
        self.state = reduce(self.state, Displayed(self._run.history[index]))


@pytest.fixture
def session(run: CurrentRun, tmp_path: Path) -> FakeSession:
    return FakeSession(run, tmp_path)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    found = SimpleNamespace(now=1000.0)
    monkeypatch.setattr(screens, "time", SimpleNamespace(monotonic=lambda: found.now))
    return found


@pytest.fixture
def screen(server: viser.ViserServer, session: FakeSession, clock, monkeypatch: pytest.MonkeyPatch) -> Screen:
    monkeypatch.setattr(server, "gui", Gui(server))
    monkeypatch.setattr(screens, "PortlessViser", lambda label: SimpleNamespace(server=server))
    made: Any = Screen(session)  # type: ignore[arg-type]
    made.show_tabs(made.tabs)
    return made


class Shown:
    """A panel that notes the frames that it shows."""

    def __init__(self) -> None:
        self.frames: list[int] = []

    def show(self, state: State) -> None:
        self.frames.append(state.index)


@pytest.fixture
def shown(screen: Screen) -> Shown:
    screen.add("Methods", found := Shown())
    return found


def test_every_panel_shows_the_frame(screen: Screen, session: FakeSession, shown: Shown):
    screen.paint()
    session.seek(17)
    screen.paint()
    assert shown.frames == [N + 4 - 1, 17]
    assert not session.asked, "showing asks for nothing"


def test_what_nobody_sees_is_not_painted_until_its_tab_is_opened(screen: Screen, session: FakeSession, shown: Shown):
    screen.show_tabs(frozenset({"Files"}))
    screen.paint()
    session.seek(17)
    screen.paint()
    assert not shown.frames
    screen.show_tabs(frozenset({"Files", "Methods"}))
    screen.paint()
    screen.paint()
    assert shown.frames == [17]


def test_a_state_that_did_not_change_is_not_painted_again(screen: Screen, monkeypatch: pytest.MonkeyPatch):
    screen.paint()
    screen.add("Methods", SimpleNamespace(show=lambda state: pytest.fail("painted again")))  # type: ignore[arg-type]
    screen.paint()


def test_while_it_plays_the_panels_are_painted_ten_times_a_second(
    screen: Screen, session: FakeSession, clock, shown: Shown
):
    session.becomes(playing=True)
    screen.paint()
    session.seek(5)
    screen.paint()
    assert shown.frames == [N + 4 - 1]
    clock.now += screens.PLAYING_S
    screen.paint()
    assert shown.frames == [N + 4 - 1, 5]


def test_a_panel_that_fails_is_reported_once_and_the_others_go_on(
    screen: Screen, session: FakeSession, shown: Shown, caplog: pytest.LogCaptureFixture
):
    def broken(state: State) -> None:
        raise ValueError("no such colour")

    screen.add("Files", SimpleNamespace(show=broken))  # type: ignore[arg-type]
    with caplog.at_level(logging.CRITICAL):
        for index in (3, 4):
            session.seek(index)
            screen.paint_or_report()
    assert shown.frames == [3, 4]
    (notice,) = session.asked
    assert isinstance(notice, do.Notify) and "no such colour" in notice.text


def test_the_thread_paints_until_it_is_closed(screen: Screen, session: FakeSession, monkeypatch: pytest.MonkeyPatch):
    painted = Event()
    monkeypatch.setattr(screen, "paint", painted.set)
    monkeypatch.setattr(screen.server, "stop", lambda: None)
    before = set(threading.enumerate())
    screen.start()
    assert painted.wait(10)
    begun = set(threading.enumerate()) - before
    screen.close()
    assert begun and not any(thread.is_alive() for thread in begun)


def test_the_record_panel_shows_what_is_recorded(screen: Screen, session: FakeSession):
    session.becomes(recording=Recording("flight.rrd", 1_500_000, 12))
    screen.paint()
    assert "Recording flight.rrd: 12 of" in screen.server.gui.text
