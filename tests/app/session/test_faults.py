"""What goes wrong beside the run is told, and the run goes on; what was asked for meanwhile is not lost."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event, current_thread

import pytest
from ispom_app.engine.events import Opened, Stepped
from ispom_app.engine.history.history import History
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_folder.run_folder import is_unfinished, locked
from ispom_app.features.branches.commands import Fork
from ispom_app.features.recording.commands import Record, RepairRecordings, StopRecording
from ispom_app.features.recording.listing import list_recordings, list_unfinished
from ispom_app.features.recording.state import Recordings
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.views.rerun.file_recording import FileRecording

from ispom.errors import InputError
from ispom.io.whole import part_of
from ispom.methods import Config
from ispom.types import Measurement, Sequence
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build, opener, paused_session, started, wait_for
from tests.app.recorded import entities_in, exposures_in
from tests.app.strangers import killed_run


class Gate:
    """A source whose frame `at` takes until `opened` is set."""

    def __init__(self, at: int) -> None:
        self.at, self.reached, self.opened = at, Event(), Event()

    def __call__(self, source: str) -> Sequence:
        sequence = opener(source)

        def load(i: int) -> Measurement:
            if i == self.at:
                self.reached.set()
                assert self.opened.wait(20)
            return sequence.load(i)

        return replace(sequence, load=load)


@pytest.fixture
def paused(tmp_path: Path) -> Iterator[Session]:
    with paused_session(tmp_path) as session:
        session.post(do.Speed(None))
        yield session


def test_five_steps_requested_during_a_slow_frame_move_by_five(tmp_path: Path) -> None:
    gate = Gate(3)
    session = started(tmp_path, opener=gate, autoplay=False)
    session.post(do.Seek(3))
    assert gate.reached.wait(20)
    for _ in range(5):
        session.post(do.StepBy(1))
    gate.opened.set()
    wait_for(lambda: session.state.target is None and session.state.index == 8, "five steps")
    assert session.state.computed == 9 and session.close(5.0)


def test_a_run_that_begins_while_a_recording_is_closed_is_not_in_it(
    paused: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paused.post(do.Seek(8))
    wait_for(lambda: paused.state.computed == 9, "the first run")
    disk, write = Event(), FileRecording.write

    def slow(self: FileRecording, event) -> None:
        assert disk.wait(20)
        write(self, event)

    monkeypatch.setattr(FileRecording, "write", slow)
    paused.post(Record("first"))
    wait_for(lambda: paused.state[Recordings].current is not None, "recording")
    paused.post(do.Restart(("stereo",), Config()))
    wait_for(lambda: paused.state.run == 2 and paused.state.ended, "the second run")
    paused.post(Record("second"))
    disk.set()
    wait_for(lambda: len(paused.state[Recordings].listed) == 1, "the first file")
    paused.post(StopRecording())
    wait_for(lambda: len(paused.state[Recordings].listed) == 2, "the second file")
    assert exposures_in(tmp_path / "first.rrd") == set(range(9))
    assert {"/world/monocular/final", "/world/integrated/final"} <= entities_in(tmp_path / "first.rrd")
    assert exposures_in(tmp_path / "second.rrd") == set(range(22)) and not paused.state.notices


def test_a_failed_opening_leaves_the_live_camera_recording(tmp_path: Path) -> None:
    stopped = list[str]()

    def live(source: str) -> Sequence:
        if source == "nowhere":
            raise InputError("nowhere does not exist: correct the path")
        whole = opener("double:6")
        return replace(whole, grow=lambda *_: live(source), stop=lambda: stopped.append(source))

    session = started(tmp_path, "camera", opener=live)
    wait_for(lambda: session.state.phase == "ready", "the camera")
    session.post(do.Open("nowhere"))
    wait_for(lambda: session.state.notices, "the failure")
    assert session.state.source == "camera" and not stopped
    session.post(do.Open("another"))
    wait_for(lambda: session.state.source == "another" and session.state.phase == "ready", "another")
    assert stopped == ["camera"]
    assert session.close(5.0) and stopped == ["camera", "another"]


def test_closing_writes_the_final_trajectories(paused: Session, tmp_path: Path) -> None:
    paused.post(do.Seek(12))
    paused.post(Record("last"))
    wait_for(lambda: paused.state[Recordings].current is not None and paused.state.computed == 13, "recording")
    assert paused.close(5.0)
    assert exposures_in(tmp_path / "last.rrd") == set(range(13))
    assert "/world/stereo/final" in entities_in(tmp_path / "last.rrd")


def test_closing_while_an_exposure_takes_long_writes_what_there_is(tmp_path: Path) -> None:
    gate = Gate(9)
    session = started(tmp_path, opener=gate, autoplay=False)
    session.post(Record("busy"))
    session.post(do.Seek(15))
    assert gate.reached.wait(20)
    assert not session.close(0.1)
    assert exposures_in(tmp_path / "busy.rrd") == set(range(9))
    assert "/world/stereo/final" in entities_in(tmp_path / "busy.rrd")
    gate.opened.set()


def test_closing_during_a_replay_leaves_the_playback_to_the_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two threads that step it would pair the state of one frame with the position of another."""
    inside, opened, threads = Event(), Event(), set[str]()
    session = started(tmp_path, autoplay=False)
    session.post(do.Seek(9))
    wait_for(lambda: session.state.index == 9, "some frames")
    session.post(Fork(METHODS, Config()))
    session.post(do.Play(False))
    wait_for(lambda: len(session.state[Branches].all) == 2, "a branch")
    run = session.run
    assert run is not None
    monkeypatch.setattr(type(run), "catching_up", property(lambda _: not opened.is_set()))

    def catch_up(_: object) -> str:
        threads.add(current_thread().name)
        inside.set()
        assert opened.wait(20)
        return ""

    monkeypatch.setattr(type(run), "catch_up", catch_up)
    session.post(Record("busy"))
    session.post(do.Seek(15))
    assert inside.wait(20)
    assert not session.close(0.1)
    assert threads == {"session"}
    assert (tmp_path / "busy.rrd").exists()
    opened.set()


def test_links_that_lead_nowhere_and_unfinished_files_are_not_listed(tmp_path: Path) -> None:
    (tmp_path / "old.rrd").symlink_to(tmp_path / "gone")
    (tmp_path / ".part-running.rrd").write_bytes(b"half")
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / os.fsdecode(b"caf\xe9.rrd")).write_bytes(b"of a name that no page can show")
    (tmp_path / "whole.rrd").write_bytes(b"all of it")
    assert [file.name for file in list_recordings(tmp_path)] == ["whole.rrd"]
    session = started(tmp_path, autoplay=False)
    wait_for(lambda: session.state.phase == "ready", "opening")
    assert not session.state.notices and session.close(5.0)


def test_what_a_stopped_app_left_unfinished_is_listed_and_repaired(tmp_path: Path) -> None:
    left, running = tmp_path / "left.rrd", tmp_path / "running.rrd"
    run = Playback(doubles.sequence(), METHODS, builder=build)
    with FileRecording(left, run.opened) as file:
        file.write(run.step())
    left.rename(part_of(left))
    foreign = tmp_path / ".part-foreign.rrd"
    foreign.write_bytes(b"somebody else's, or another version's")
    (tmp_path / ".part-empty.rrd").write_bytes(b"")
    with FileRecording(running, run.opened):
        session = started(tmp_path, autoplay=False)
        wait_for(lambda: session.state.phase == "ready", "opening")
        left_over = [each.name for each in list_unfinished(tmp_path)]
        assert left_over == [
            ".part-empty.rrd",
            ".part-foreign.rrd",
            ".part-left.rrd",
        ]
        session.post(RepairRecordings())
        wait_for(lambda: session.state[Recordings].listed and list_unfinished(tmp_path) == (foreign,), "the repair")
        assert [file.name for file in session.state[Recordings].listed] == ["left.rrd"] and exposures_in(left) == {0}
        assert ".part-foreign.rrd" in session.state.notices[-1].text and session.close(5.0)
    assert foreign.read_bytes() == b"somebody else's, or another version's"


def test_a_run_that_was_killed_is_repaired_in_the_page_and_listed_then(tmp_path: Path) -> None:
    left = killed_run(tmp_path / "made", recording=False)
    recordings = tmp_path / "recordings"
    killed, running = (Path(shutil.copytree(left, recordings / name)) for name in ("killed", "running"))
    before = {path.name: path.read_bytes() for path in running.iterdir()}
    with locked(running):
        session = started(recordings, autoplay=False)
        wait_for(lambda: session.state.phase == "ready", "opening")
        assert list_unfinished(recordings) == (killed,) and not session.state[Recordings].listed
        session.post(RepairRecordings())
        wait_for(lambda: session.state[Recordings].listed, "the repair")
        assert [found.name for found in session.state[Recordings].listed] == ["killed"]
        assert not session.state.notices and session.close(5.0)
        assert {name: (running / name).read_bytes() for name in before} == before
    assert (killed / "stereo.tum").is_file() and not is_unfinished(killed)


def test_a_fault_anywhere_in_the_worker_is_reported_and_survived(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, paused: Session
) -> None:
    def fault(_: Path) -> None:
        raise PermissionError("not yours")

    monkeypatch.setattr("ispom_app.features.recording.service.list_recordings", fault)
    paused.post(Record("r"))
    wait_for(lambda: paused.state[Recordings].current is not None, "recording")
    paused.post(StopRecording())
    wait_for(lambda: paused.state.notices, "a notice")
    assert "not yours" in paused.state.notices[-1].text
    paused.post(do.Seek(2))
    wait_for(lambda: paused.state.index == 2, "going on")


class Viewer:
    """Fails when told to, as a stream does."""

    def __init__(self, *bad: int) -> None:
        self.bad, self.runs, self.failed = list(bad), list[tuple[Opened, History]](), False

    def open(self, opened: Opened, history: History, beginning: Path | None = None) -> None:
        self.runs.append((opened, history))
        self.failed = False

    def look_at(self, index: int) -> None: ...

    def check(self) -> None:
        if self.failed:
            raise OSError("the disk is full")

    def write(self, event) -> None:
        if isinstance(event, Stepped) and event.index in self.bad:
            self.bad.remove(event.index)
            raise RuntimeError("gone")


def test_a_viewer_that_fails_is_started_again_with_the_run_so_far(tmp_path: Path) -> None:
    viewer = Viewer(5)
    session = started(tmp_path, live=viewer)
    session.post(do.Speed(None))
    wait_for(lambda: session.state.ended, "the end")
    assert [len(history) for _, history in viewer.runs] == [22, 22] and viewer.runs[1][1] is session.history
    assert [n.text for n in session.state.notices] == [
        "The live view failed and was started again (RuntimeError: gone)."
    ]
    assert session.close(5.0)


def test_a_viewer_that_fails_again_is_left_until_the_next_run(tmp_path: Path) -> None:
    viewer = Viewer(5, 6)
    session = started(tmp_path, live=viewer)
    session.post(do.Speed(None))
    wait_for(lambda: session.state.ended, "the end")
    assert session.state.notices[-1].text == "Live view stopped (RuntimeError: gone); computation continues."
    assert len(session.state.notices) == 2 and len(viewer.runs) == 2
    session.post(do.Restart(("stereo",), Config()))
    wait_for(lambda: session.state.run == 2 and session.state.ended, "the second run")
    assert len(viewer.runs) == 3 and viewer.runs[2][0].methods == ("stereo",)
    assert session.close(5.0)


def test_a_viewer_that_fails_while_nothing_runs_is_noticed(tmp_path: Path) -> None:
    viewer = Viewer()
    session = started(tmp_path, live=viewer, autoplay=False)
    wait_for(lambda: session.state.phase == "ready", "opening")
    viewer.failed = True
    wait_for(lambda: session.state.notices, "a notice")
    assert "disk is full" in session.state.notices[0].text and len(viewer.runs) == 2
    assert session.close(5.0)


def test_a_history_beyond_its_memory_is_stepped_back_through(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False, history_bytes=50_000)
    session.post(do.Seek(21))
    wait_for(lambda: session.state.computed == 22, "the run")
    assert session.history.used_bytes <= 50_000
    for index in range(20, -1, -1):
        session.post(do.StepBy(-1))
        wait_for(lambda index=index: session.state.index == index, "a step back")
        assert session.state.displayed is not None and session.state.displayed.steps[0].tracks
    assert session.close(5.0)
