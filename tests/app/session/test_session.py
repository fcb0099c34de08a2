"""The worker: play, step, seek, record, recover. No browser and no viewer here."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from ispom_app.features.recording.commands import Record, StopRecording
from ispom_app.features.recording.state import Recordings
from ispom_app.session import commands as do
from ispom_app.session.session import Session

from ispom.errors import InputError
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.methods import Config
from ispom.types import Sequence
from tests import doubles
from tests.app.helpers import opener, paused_session, started, wait_for
from tests.app.recorded import exposures_in


@pytest.fixture
def paused(tmp_path: Path) -> Iterator[Session]:
    with paused_session(tmp_path) as session:
        session.post(do.Speed(None))
        yield session


def go(session: Session, command: do.Command, index: int) -> None:
    session.post(command)
    wait_for(lambda: session.state.index == index and session.state.target is None, f"frame {index}")


def test_it_plays_by_itself_to_the_end(tmp_path: Path):
    session = started(tmp_path)
    session.post(do.Speed(None))
    wait_for(lambda: session.state.ended, "the end")
    assert session.state.computed == session.state.total == len(session.history) == 22
    assert not session.state.playing and session.state.statuses["stereo"].error_m is not None
    assert session.close(5.0)


def test_steps_forward_compute_and_steps_back_do_not(paused: Session):
    for i in range(4):
        go(paused, do.StepBy(1), i)
    computed = list(paused.history)
    go(paused, do.StepBy(-1), 2)
    go(paused, do.StepBy(-1), 1)
    assert paused.state.computed == 4 and paused.state.displayed is computed[1]
    go(paused, do.StepBy(1), 2)
    assert list(paused.history) == computed


def test_a_step_back_from_the_start_stays_there(paused: Session):
    go(paused, do.StepBy(1), 0)
    paused.post(do.StepBy(-1))
    go(paused, do.StepBy(1), 1)


def test_seeking_ahead_computes_up_to_there_and_the_newest_wins(paused: Session):
    for index in (19, 18, 7):
        paused.post(do.Seek(index))
    wait_for(lambda: paused.state.index == 7 and paused.state.target is None, "the newest seek")
    assert paused.state.computed <= 20
    go(paused, do.Seek(0), 0)
    go(paused, do.Seek(1000), paused.state.total - 1)
    assert paused.state.ended


def test_playing_from_the_past_goes_through_the_history_first(paused: Session):
    go(paused, do.Seek(10), 10)
    go(paused, do.Seek(3), 3)
    before = list(paused.history)
    paused.post(do.Play(True))
    wait_for(lambda: paused.state.ended, "the end")
    assert list(paused.history)[:11] == before


def test_playing_again_at_the_end_starts_over_from_history(paused: Session):
    go(paused, do.Seek(21), 21)
    run, history = paused.state.run, paused.history
    paused.post(do.Play())
    wait_for(lambda: paused.state.playing, "playing")
    wait_for(lambda: not paused.state.playing and paused.state.index == 21, "the end again")
    assert paused.state.run == run and paused.history is history


def test_a_restart_takes_the_new_settings(paused: Session):
    go(paused, do.Seek(5), 5)
    config = Config().with_settings("monocular", ModernMonocularConfig(max_tracks=300))
    paused.post(do.Restart(("monocular",), config))
    wait_for(lambda: paused.state.run == 2 and paused.state.ended, "the second run")
    assert paused.state.methods == ("monocular",) and paused.state.config == config


def test_a_broken_image_stops_the_run_and_loses_nothing(tmp_path: Path):
    def broken(source: str) -> Sequence:
        sequence = opener(source)

        def load(i: int):
            if i == 9:
                raise InputError("image_0/000009.png is cut off")
            return sequence.load(i)

        return replace(sequence, load=load)

    session = started(tmp_path, opener=broken)
    session.post(do.Speed(None))
    wait_for(lambda: session.state.notices, "a notice")
    assert session.state.notices[-1].text == "image_0/000009.png is cut off"
    assert not session.state.playing and session.state.computed == 9
    go(session, do.Seek(2), 2)
    session.post(do.StepBy(100))
    wait_for(lambda: len(session.state.notices) == 2, "the same notice again")
    assert session.close(5.0)


def test_a_fault_of_the_program_is_reported_and_survived(paused: Session, monkeypatch: pytest.MonkeyPatch):
    def fault(*_):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("ispom_app.engine.playback.Playback.step", fault)
    paused.post(do.StepBy(1))
    wait_for(lambda: paused.state.notices, "a notice")
    assert "internal fault" in paused.state.notices[-1].text
    monkeypatch.undo()
    go(paused, do.StepBy(1), 0)


@pytest.mark.parametrize(
    ("fault", "said"),
    [(InputError("nowhere does not exist: correct the path"), "does not exist"), (KeyError("x"), "internal fault")],
)
def test_a_source_that_does_not_open_leaves_the_one_before(tmp_path: Path, fault: Exception, said: str):
    def choosy(source: str) -> Sequence:
        if source == "nowhere":
            raise fault
        return opener(source)

    session = started(tmp_path, opener=choosy, autoplay=False)
    go(session, do.StepBy(1), 0)
    session.post(do.Open("nowhere"))
    wait_for(lambda: session.state.notices, "a notice")
    assert said in session.state.notices[-1].text and session.state.activity is None
    assert session.state.phase == "ready" and session.state.index == 0 and session.state.source == "double:20"
    assert session.close(5.0)


def test_a_source_that_never_opened_can_be_replaced(tmp_path: Path):
    def choosy(source: str) -> Sequence:
        if source == "bad":
            raise InputError("bad does not exist: correct the path")
        return opener(source)

    session = started(tmp_path, "bad", opener=choosy)
    wait_for(lambda: session.state.phase == "failed", "the failure")
    session.post(do.StepBy(1))
    session.post(Record(""))
    session.post(do.Open("double:10"))
    wait_for(lambda: session.state.phase == "ready", "opening")
    assert session.close(5.0)


def test_the_history_is_small(paused: Session):
    go(paused, do.Seek(2), 2)
    tracemalloc.start()
    go(paused, do.Seek(20), 20)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown / 18 < 0.5e6


def test_a_recording_holds_the_run_from_its_start(paused: Session, tmp_path: Path):
    go(paused, do.Seek(8), 8)
    paused.post(Record("mine"))
    go(paused, do.StepBy(1), 9)
    paused.post(StopRecording())
    wait_for(lambda: paused.state[Recordings].listed, "the file")
    assert paused.state[Recordings].current is None and paused.state[Recordings].listed[0].name == "mine.rrd"
    assert exposures_in(tmp_path / "mine.rrd") == set(range(10))


@pytest.mark.parametrize("name", ["../escape", "a/b", "a\\b", "..", ".hidden", "x" * 200, "nul\0"])
def test_a_recording_has_a_name_not_a_path(paused: Session, tmp_path: Path, name: str):
    paused.post(Record(name))
    wait_for(lambda: paused.state.notices, "a notice")
    assert "plain file name" in paused.state.notices[-1].text and not list(tmp_path.rglob("*.rrd"))


def test_a_recording_never_overwrites(paused: Session, tmp_path: Path):
    (tmp_path / "kept.rrd").write_bytes(b"precious")
    paused.post(Record("kept"))
    wait_for(lambda: paused.state.notices, "a notice")
    assert (tmp_path / "kept.rrd").read_bytes() == b"precious"


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    session = started(blocked / "recordings", autoplay=False)
    session.post(Record(""))
    wait_for(lambda: session.state.notices, "a notice")
    assert "cannot be written" in session.state.notices[-1].text
    assert session.close(5.0)


def test_a_full_disk_stops_the_recording_not_the_run(paused: Session, monkeypatch: pytest.MonkeyPatch):
    go(paused, do.StepBy(1), 0)
    paused.post(Record("full"))
    wait_for(
        lambda: paused.state[Recordings].current is not None and paused.state[Recordings].current.written == 1,
        "recording",
    )

    def full(self, event) -> None:
        self.failure = "full.rrd could not be written on (No space left on device): free some space and record again"

    monkeypatch.setattr("ispom_app.views.rerun.file_recording.FileRecording.write", full)
    go(paused, do.StepBy(1), 1)
    wait_for(lambda: paused.state[Recordings].current is None, "the end of the recording")
    assert "No space left" in paused.state.notices[0].text
    go(paused, do.StepBy(1), 2)


def test_shutting_down_closes_the_recording(tmp_path: Path):
    session = started(tmp_path)
    wait_for(lambda: session.state.phase == "ready", "opening")
    session.post(Record("last"))
    wait_for(
        lambda: session.state[Recordings].current is not None and session.state[Recordings].current.written > 3,
        "recording",
    )
    assert session.close(3.0)
    assert exposures_in(tmp_path / "last.rrd") == set(range(len(session.history)))


def test_the_stand_in_is_what_the_tests_count_on():
    assert len(doubles.sequence(20)) == 22
