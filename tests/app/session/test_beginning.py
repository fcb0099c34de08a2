"""A run whose first frames come with it: they are shown at once, and replaced as they are computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from ispom_app.engine.differences.compare import divergences, record_rows
from ispom_app.engine.options import SourceOptions
from ispom_app.engine.playback import Playback
from ispom_app.features.branches.commands import Fork
from ispom_app.features.page.command import DEMO, RECORDED
from ispom_app.features.tracks.commands import Pick
from ispom_app.session import commands as do
from ispom_app.session import player
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.views.rerun.live import LiveStream
from ispom_app.views.web.messages import message_of

from ispom.ensemble import build as real
from ispom.methods import Config
from tests.app.helpers import build_full, open_source, ran, started, wait_for
from tests.sequences.kitti_folder import make_drive

KNOWN = 12
"""Recorded frames, of 28: fourteen pairs, each a video frame and a stereo frame."""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_drive(tmp_path_factory.mktemp("drive") / "kitti", KNOWN + 2)


@pytest.fixture(scope="module")
def recorded(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "run"
    return ran(drive, folder, "--max-exposures", str(KNOWN), builder=build_full)


@pytest.fixture
def computing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Event]:
    """Nothing is computed until it is set."""
    monkeypatch.setattr(player, "ALONE_S", 0.0)
    free, step = Event(), Playback.step

    def held(playback: Playback) -> object:
        assert free.wait(60)
        return step(playback)

    monkeypatch.setattr(Playback, "step", held)
    yield free
    free.set()


@pytest.fixture
def session(drive: Path, recorded: Path, tmp_path: Path, computing: Event) -> Iterator[Session]:
    found = opened(tmp_path, drive, recorded)
    yield found
    computing.set()
    found.close(5)


def opened(tmp_path: Path, drive: Path, recorded: Path, **options) -> Session:
    options = {"opener": open_source, "builder": build_full, "beginnings": {str(drive): recorded}, **options}
    session = started(tmp_path, str(drive), **options)
    wait_for(lambda: session.state.phase == "ready" and session.state.index >= 0, "the run")
    return session


def origin(session: Session) -> str | None:
    return message_of(session.state)["origin"]


def goes_round(session: Session) -> None:
    """A pair has the time of its video frame, which is therefore on the screen for no time, as the first frame is."""
    wait_for(lambda: session.state.index == KNOWN - 1, "the last recorded frame")
    wait_for(lambda: session.state.index < KNOWN - 1, "the first ones again")


def test_it_plays_at_once_and_goes_round_while_nothing_is_computed(session: Session) -> None:
    wait_for(lambda: session.state.playing, "the start")
    assert origin(session) == "recorded"
    assert session.state.computed == KNOWN and session.state.total == 28 and not session.state.ended
    session.post(do.Speed(None))
    goes_round(session)
    assert session.run is not None and session.run.history.computed == 0


def test_what_is_computed_takes_over_at_the_frame_shown(session: Session, computing: Event) -> None:
    session.post(do.Seek(5))
    wait_for(lambda: session.state.index == 5 and not session.state.playing, "the frame")
    before, run = session.state.displayed, session.run
    session.post(Pick("video", 5, 40.0, 30.0))
    wait_for(lambda: session.state.notices, "why no track is selected")
    assert "recorded" in session.state.notices[-1].text
    assert before is not None and before.stored is not None and origin(session) == "recorded" and run is not None
    values = [run.series.row(i, run.series.quantities.values()) for i in range(KNOWN)]
    computing.set()
    wait_for(lambda: session.state.recorded == range(KNOWN, KNOWN), "the recorded frames")
    after = session.state.displayed
    assert after is not None and after.index == 5 and after.stored is None and origin(session) == "live"
    assert session.state.computed == KNOWN and session.run is run and not session.state.playing
    for index, recorded in enumerate(values):
        own = run.series.row(index, run.series.quantities.values())
        assert _without_times(own) == _without_times(recorded)
    methods = run.playback.methods
    assert not list(
        divergences(record_rows(before, frozenset(methods)), record_rows(after, frozenset(methods)), methods)
    )


def _without_times(row: dict) -> dict:
    return {m: {key: value for key, value in values.items() if key != "seconds"} for m, values in row.items()}


def test_beyond_the_recorded_frames_it_is_computed(session: Session, computing: Event) -> None:
    session.post(do.Seek(20))
    wait_for(lambda: session.state.target == 20, "the target")
    computing.set()
    wait_for(lambda: session.state.index == 20, "the frame")
    assert origin(session) == "live" and session.run is not None and session.run.history.computed == 21
    session.post(do.Play(True))
    session.post(do.Speed(None))
    wait_for(lambda: session.state.ended, "the end")
    assert session.state.computed == 28 and len(session.run.series) == 28
    assert session.run.tally.methods["stereo"].exposures == 14


def test_a_fork_of_recorded_frames_is_computed(session: Session, computing: Event) -> None:
    session.post(do.Seek(5))
    wait_for(lambda: session.state.index == 5, "the frame")
    computing.set()
    session.post(Fork(session.state.methods, Config()))
    wait_for(lambda: len(session.state[Branches].all) == 2, "the fork")
    session.post(do.Seek(9))
    wait_for(lambda: session.state.index == 9, "the frame")
    assert origin(session) is None and session.run is not None and session.run.history[9].stored is None


def test_a_fault_of_the_computation_is_shown_once(
    drive: Path, recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(playback: Playback) -> object:
        raise RuntimeError("no estimator")

    monkeypatch.setattr(player, "ALONE_S", 0.0)
    monkeypatch.setattr(Playback, "step", fails)
    session = opened(tmp_path, drive, recorded)
    wait_for(lambda: session.state.notices, "the fault")
    session.post(do.Seek(3))
    wait_for(lambda: session.state.index == 3, "a recorded frame")
    session.post(do.Seek(4))
    wait_for(lambda: session.state.index == 4, "a recorded frame")
    assert session.state.notice_count == 1
    session.close(5)


@pytest.mark.parametrize(
    "options",
    [{"methods": ("stereo",)}, {"source_options": SourceOptions(stereo_every=2)}, {"beginnings": {}}],
    ids=["other methods", "another source", "none"],
)
def test_other_runs_do_not_begin_with_it(
    options: dict, drive: Path, recorded: Path, tmp_path: Path, computing: Event
) -> None:
    computing.set()
    session = opened(tmp_path, drive, recorded, **options)
    assert origin(session) is None and session.run is not None and session.run.recorded is None
    session.close(5)


def test_the_views_keep_the_run_and_change_only_what_differs(
    drive: Path, recorded: Path, tmp_path: Path, computing: Event
) -> None:
    live = LiveStream()
    session = opened(tmp_path, drive, recorded, live=live)
    session.post(do.Seek(5))
    wait_for(lambda: live.tape is not None and live.tape.end == KNOWN, "the recorded frames")
    tape = live.tape
    assert tape is not None
    before = tape.scene(5)
    assert before.versions and not before.missing
    shown = {part: tape.value(part, version) for part, version in before.versions.items()}
    computing.set()
    wait_for(lambda: tape.scene(5).versions != before.versions, "its own values")
    after = tape.scene(5)
    assert live.tape is tape and after.versions.keys() == before.versions.keys()
    for part, version in after.versions.items():
        found, recorded_columns = tape.value(part, version), shown[part]
        assert found is not None and recorded_columns is not None
        if part[1] != "EncodedImage":
            assert found.to_pydict() == recorded_columns.to_pydict(), part
    session.close(5)


def test_nothing_is_computed_before_the_frames_move_in_a_viewer(
    drive: Path, recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(player, "ALONE_S", 1000.0)
    live = LiveStream()
    session = opened(tmp_path, drive, recorded, live=live)
    goes_round(session)
    assert live.tape is not None and session.run is not None and session.run.history.computed == 0
    live.tape.scene(0)
    live.tape.scene(1)
    wait_for(lambda: session.run is not None and session.run.history.computed > 1, "frames that are computed")
    session.close(5)


ALIKE_M = 1e-3
"""Other processors may give other last digits."""


def test_the_demo_begins_as_it_is_computed_here() -> None:
    """Where this fails, the methods have changed: python -m tests.app.demo_run makes the recorded frames again."""
    from ispom_app.session.current_run import CurrentRun
    from ispom_app.session.sources.opening import SourceOpener

    sources = SourceOpener(open_source, real, "modern", beginnings={DEMO: RECORDED})
    playback = sources.playback(DEMO, None, None, Config(), strict=True, progress=lambda text: None)
    run = sources.begun(playback, DEMO, SourceOptions(), 100_000_000)
    assert isinstance(run, CurrentRun)
    before = [run.history[i] for i in range(25)]
    for recorded in before:
        _, own = run.step()
        assert own.kind == recorded.kind and [s.method for s in own.steps] == [s.method for s in recorded.steps]
        for step, known in zip(own.steps, recorded.steps, strict=True):
            assert (step.status, step.key_frame) == (known.status, known.key_frame)
            assert (step.world_from_frame is None) == (known.world_from_frame is None)
            if step.world_from_frame is not None and known.world_from_frame is not None:
                apart = step.world_from_frame.translation - known.world_from_frame.translation
                assert np.linalg.norm(apart) < ALIKE_M
