"""A run that is over, in the session: shown at once, found in, and gone on from."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from ispom_app.features.bookmarks.commands import PutBookmark
from ispom_app.features.bookmarks.service import Bookmarks
from ispom_app.features.branches.commands import Fork, ShowBranch
from ispom_app.features.breakpoints.commands import FindMatch
from ispom_app.features.recording.commands import OpenNamed, PutNote, Record, StopRecording
from ispom_app.features.recording.listing import list_recordings
from ispom_app.features.recording.state import ListedRun, Recordings
from ispom_app.features.runs.commands import CompareRuns
from ispom_app.features.tracks.commands import Inspection, Pick
from ispom_app.features.tracks.panel import LookTab, looked_at
from ispom_app.features.tracks.track_picture import track_picture
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.review.folder import read_stored
from ispom_app.session.review.recorded_tracks import RecordedViews
from ispom_app.session.session import Session
from ispom_app.session.sources.folders import Folders, run_name
from ispom_app.views.rerun.live import LiveStream
from ispom_app.views.rerun.stored_tape import StoredTape
from ispom_app.views.viser.screen import Screen

from ispom.sequences import open_sequence
from ispom.types import Tracks, TrackStatus
from tests import doubles
from tests.app.helpers import build_full, open_source, ran, started, wait_for
from tests.sequences.kitti_folder import make_drive


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("stored")
    drive = str(make_drive(place / "kitti", 14))
    return ran(drive, place / "run", "--stereo-every", "2", builder=build_full)


def opened(tmp_path: Path, source: Path, **options) -> Session:
    session = started(tmp_path, str(source), opener=open_source, builder=build_full, **options)
    wait_for(lambda: session.state.phase != "opening" and session.state.index >= 0, "the run")
    return session


@pytest.fixture
def session(run: Path, tmp_path: Path) -> Iterator[Session]:
    found = opened(tmp_path, run)
    yield found
    found.close(5)


def test_a_run_that_may_be_forked_or_diagnosed_is_compiled_for(run: Path, tmp_path: Path) -> None:
    begun = list[tuple[str, ...]]()
    session = opened(tmp_path, run, compiling=lambda methods, config: begun.append(methods))
    try:
        assert session.state.total > 0 and begun == [session.state.methods]
    finally:
        session.close(5)


def test_it_is_shown_at_its_end_and_nothing_is_computed(session: Session) -> None:
    state = session.state
    assert (state.index, state.computed, state.total, state.ended) == (20, 21, 21, True) and not state.playing
    assert state[Branches].all[0].name == "stored run" and state[Branches].all[0].tally.methods["stereo"].exposures == 7
    assert session.run is not None and session.run.playback.position == 0
    session.post(do.Seek(4))
    wait_for(lambda: session.state.index == 4, "the frame")
    session.post(FindMatch('monocular.status == "lost"'))
    wait_for(lambda: session.state.index > 4, "the loss")
    assert session.state.statuses["monocular"].status == "lost"
    assert session.run.playback.position == 0


def test_playing_it_starts_over_and_ends_at_its_end(session: Session) -> None:
    session.post(do.Speed(None))
    session.post(do.Play(True))
    wait_for(lambda: session.state.index < 20, "the start")
    wait_for(lambda: session.state.index == 20 and not session.state.playing, "the end")
    assert session.run is not None and session.run.playback.position == 0


def test_a_fork_of_it_is_the_run_again(session: Session) -> None:
    session.post(do.Seek(9))
    wait_for(lambda: session.state.index == 9, "the frame")
    state = session.state
    session.post(Fork(state.methods, state.config))
    session.post(do.Speed(None))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.ended, "the fork")
    assert not [n.text for n in session.state.notices if "stored run" in n.text]
    session.post(CompareRuns("live:1", "live:0"))
    wait_for(
        lambda: session.state[Branches].comparison is not None and session.state[Branches].comparison.finished,
        "the comparison",
    )
    comparison = session.state[Branches].comparison
    assert comparison is not None and (comparison.start, comparison.stop, comparison.differing_frames) == (10, 21, 0)


def test_a_replay_that_is_another_run_is_noticed_once(run: Path, tmp_path: Path) -> None:
    def other(config, methods, rig):
        return doubles.ensemble(methods, doubles.FakeEstimator)

    session = started(tmp_path, str(run), opener=open_source, builder=other)
    wait_for(lambda: session.state.index == 20, "the run")
    session.post(do.Seek(15))
    wait_for(lambda: session.state.index == 15, "the frame")
    session.post(Fork(session.state.methods, session.state.config))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.ended, "the fork")
    said = [n.text for n in session.state.notices if "the replay is not the stored run" in n.text]
    assert len(said) == 1 and "at frame 0" in said[0]
    session.close(5)


def test_without_its_source_all_but_computing_works(run: Path, tmp_path: Path) -> None:
    drive = run.parent / "kitti"
    drive.rename(run.parent / "moved")
    try:
        session = opened(tmp_path, run)
    finally:
        (run.parent / "moved").rename(drive)
    assert any("computed anew" in n.text and n.kind == "info" for n in session.state.notices)
    session.post(do.Seek(3))
    wait_for(lambda: session.state.index == 3, "the frame")
    for command in (
        Fork(session.state.methods, session.state.config),
        do.Restart(session.state.methods, session.state.config),
    ):
        count = session.state.notice_count
        session.post(command)
        wait_for(lambda count=count: session.state.notice_count > count, "the refusal")
        assert "computed anew" in session.state.notices[-1].text
    assert session.state.index == 3 and len(session.state[Branches].all) == 1
    session.close(5)


def test_without_its_source_and_a_recording_it_is_drawn_without_images(run: Path, tmp_path: Path) -> None:
    """The viewer stopped at the first image, with a traceback on the terminal."""
    kept, live = Path(shutil.copytree(run, tmp_path / "kept")), LiveStream()
    (kept / "run.rrd").unlink()
    drive = run.parent / "kitti"
    drive.rename(run.parent / "moved")
    try:
        session = opened(tmp_path, kept, live=live)
        feed = live._feed
        assert feed is not None
        wait_for(lambda: live._failure or (feed.position == 21 and 20 not in feed._bare), "all that is drawn")
    finally:
        (run.parent / "moved").rename(drive)
    assert not live._failure
    session.close(5)
    live.close()


def test_a_recording_in_a_runs_folder_opens_the_run(run: Path, tmp_path: Path) -> None:
    session = opened(tmp_path, run / "run.rrd")
    assert session.state.methods == ("monocular", "stereo", "integrated") and session.state.total == 21
    session.close(5)


def test_from_the_page_only_runs_below_the_root_are_opened(run: Path, tmp_path: Path) -> None:
    (tmp_path / "root").mkdir()
    session = opened(tmp_path, run, folders=Folders(tmp_path / "root"))
    elsewhere = run.parent / "copy"
    session.post(do.Open(str(elsewhere)))
    wait_for(lambda: any("outside of" in n.text for n in session.state.notices), "the refusal")
    assert session.state.total == 21
    session.close(5)


def test_other_sources_are_opened_as_ever(run: Path, tmp_path: Path) -> None:
    session = opened(tmp_path, run)
    session.post(do.Open(str(run.parent / "kitti" / "sequences" / "07")))
    session.post(do.Speed(None))
    wait_for(lambda: session.state.ended and session.state.total == 28, "the source")
    assert open_sequence(str(run.parent / "kitti" / "sequences" / "07")).name == session.state.name
    session.close(5)


def test_bookmarks_of_a_run_that_is_over_are_kept_in_its_folder(session: Session, run: Path, tmp_path: Path) -> None:
    session.post(PutBookmark("the end"))
    wait_for(lambda: session.state[Bookmarks].marks, "the bookmark")
    try:
        again = opened(tmp_path / "other", run)
        wait_for(lambda: again.state[Bookmarks].marks == session.state[Bookmarks].marks, "the bookmark")
        again.close(5)
    finally:
        (run / "notes.yaml").unlink()


def test_an_address_opens_known_runs_by_name_and_nothing_else(session: Session, run: Path, tmp_path: Path) -> None:
    for name in ("other", "../stored", str(run), "kitti"):
        count = session.state.notice_count
        session.post(OpenNamed(name))
        wait_for(lambda count=count: session.state.notice_count > count, "the refusal")
        assert "no run called" in session.state.notices[-1].text
    shutil.copytree(run, tmp_path / "below")
    before = session.state.run
    session.post(OpenNamed("below"))
    wait_for(lambda: session.state.run > before and session.state.phase == "ready", "the run below the recordings")
    assert session.state.total == 21


def test_the_list_says_what_a_run_was_on_and_opens_it_by_name(session: Session, run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "listed")
    again = opened(tmp_path, run)
    (kept,) = again.state[Recordings].listed
    assert (kept.name, kept.recording, kept.picture) == ("listed", "listed/run.rrd", "listed/thumbnail.jpg")
    assert (kept.source, kept.exposures, kept.duration_s) == (again.state.name, 21, 1.3)
    assert kept.size_bytes == sum(path.stat().st_size for path in (tmp_path / "listed").iterdir())
    before = again.state.run
    again.post(OpenNamed(run_name(kept.name)))
    wait_for(lambda: again.state.run > before and again.state.phase == "ready", "the run")
    assert again.state.source == str(tmp_path / "listed")
    again.close(5)


def test_a_note_is_stored_with_the_run_and_its_bookmarks_and_is_removed(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "noted")
    session = opened(tmp_path, tmp_path / "noted")
    session.post(PutBookmark("here"))
    for note, kept in (("jumps\nat 9 ", "jumps at 9"), ("", "")):
        session.post(PutNote("noted", note))
        wait_for(lambda kept=kept: session.state[Recordings].listed[0].note == kept, "the note")
    session.post(PutNote("noted", "jumps at 9"))
    session.post(PutNote("../noted", "x"))
    wait_for(lambda: any("'../noted' in the list" in n.text for n in session.state.notices), "the refusal")
    session.close(5)
    again = opened(tmp_path, tmp_path / "noted")
    assert again.state[Recordings].listed[0].note == "jumps at 9"
    wait_for(lambda: [b.note for b in again.state[Bookmarks].marks] == ["here"], "the bookmark")
    again.close(5)


def test_a_run_without_a_recording_is_listed_and_one_that_is_being_written_is_not(run: Path, tmp_path: Path) -> None:
    for name in ("whole", "going"):
        shutil.copytree(run, tmp_path / name)
        (tmp_path / name / "run.rrd").unlink()
    (tmp_path / "going" / "INCOMPLETE").write_text("The run has not ended.")
    (kept,) = list_recordings(tmp_path)
    assert (kept.name, kept.recording, kept.exposures) == ("whole", "", 21)


def test_a_recording_of_the_page_has_picture_length_and_bookmarks_with_it(run: Path, tmp_path: Path) -> None:
    session = opened(tmp_path, run)
    session.post(do.Seek(9))
    session.post(Fork(session.state.methods, session.state.config))
    wait_for(lambda: session.state[Branches].shown == 1, "the fork")
    session.post(do.Speed(None))
    session.post(Record("mine"))
    wait_for(lambda: session.state.ended, "the end")
    session.post(PutBookmark("end"))
    session.post(StopRecording())
    wait_for(lambda: session.state[Recordings].listed, "the file")
    (kept,) = session.state[Recordings].listed
    assert kept == ListedRun(
        "mine.rrd", (tmp_path / "mine.rrd").stat().st_size, "mine.rrd", "mine.jpg", session.state.name, 21, 1.3
    )
    session.post(PutNote("mine.rrd", "x"))
    wait_for(lambda: session.state[Recordings].listed[0].note == "x", "the note")
    session.post(OpenNamed("mine.rrd"))
    wait_for(lambda: [b.note for b in session.state[Bookmarks].marks] == ["end"], "its bookmarks")
    session.close(5)


def test_every_panel_shows_it(session: Session) -> None:
    screen = Screen(session)
    screen.show_tabs(screen.tabs)
    for exposure in (20, 7, 0):
        session.post(do.Seek(exposure))
        wait_for(lambda exposure=exposure: session.state.index == exposure, "the frame")
        screen.paint()
    screen.server.stop()


def test_a_stored_run_that_is_shown_again_after_a_fork_is_its_recording_again(run: Path, tmp_path: Path) -> None:
    live = LiveStream()
    session = opened(tmp_path, run, live=live)
    assert isinstance(live.tape, StoredTape)
    recorded = live.tape.end, live.tape.recording_id, set(live.tape.scene(8).versions)
    session.post(do.Seek(8))
    session.post(Fork(session.state.methods, session.state.config))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.ended, "the branch")
    assert not isinstance(live.tape, StoredTape)
    session.post(ShowBranch(0))
    wait_for(lambda: session.state[Branches].shown == 0, "the stored run")
    assert isinstance(live.tape, StoredTape)
    assert (live.tape.end, live.tape.recording_id, set(live.tape.scene(8).versions)) == recorded
    session.close(5)
    live.close()


def computed_tracks(run: Path, index: int, camera: str) -> Tracks:
    """As the run had them at this frame while it went on."""
    playback = read_stored(run, open_source, build_full).playback
    event = [playback.step() for _ in range(index + 1)][-1]
    return next(step.tracks[camera] for step in event.steps if camera in step.tracks)  # type: ignore[index]


def recorded(session: Session) -> RecordedViews | None:
    assert session.run is not None
    return session.run.recorded


def columns(picture: str) -> list[float]:
    """Of the points that are drawn, in order."""
    return sorted(float(u) for u in re.findall(r"M([-\d.]+) [-\d.]+h0", picture))


def reports(session: Session) -> dict[str, str]:
    """What the Look tab shows below its picture, by the panel's name."""
    html = SimpleNamespace(_report=LookTab._report, _chips=None)
    shown = looked_at(session, session.state)
    assert shown is not None
    panels = ("track", "tracks", "lifetimes", "keyframes", "residuals", "geometry")
    return {panel: LookTab._report(html, panel, shown) for panel in panels}  # type: ignore[arg-type]


@pytest.mark.parametrize("camera", ["video", "left"])
def test_the_closer_look_has_the_tracks_that_the_recording_has(session: Session, run: Path, camera: str) -> None:
    """It said "no tracks" beside a viewer that drew them."""
    shown = looked_at(session, replace(session.state, displayed=session.history[15]).having(Inspection(camera=camera)))
    assert shown is not None and shown.index is not None and shown.pictured == camera
    live = computed_tracks(run, shown.index, camera)
    text = track_picture(shown, recorded(session))
    assert len(columns(text)) == len(live) > 0 and f"{len(live)} tracks, of the recording" in text
    np.testing.assert_allclose(columns(text), np.sort(live.uv[:, 0] + 0.5), atol=0.11)
    coloured = track_picture(replace(shown, colour_by="age"), recorded(session))
    assert len(columns(coloured)) == (live.status < TrackStatus.LOST).sum()


def test_a_fork_still_has_the_tracks_of_the_exposures_before_it_and_its_own(session: Session) -> None:
    session.post(do.Seek(9))
    wait_for(lambda: session.state.index == 9, "the frame")
    session.post(Fork(session.state.methods, session.state.config))
    session.post(do.Speed(None))
    wait_for(lambda: session.state[Branches].shown == 1 and session.state.ended, "the fork")
    before, own = (
        looked_at(session, replace(session.state, displayed=session.history[index]).having(Inspection(camera="video")))
        for index in (5, 20)
    )
    assert before is not None and "of the recording" in track_picture(before, recorded(session))
    assert own is not None and "data-pick" in track_picture(own, recorded(session)) and not own.missing


def test_missing_tracks_of_a_stored_run_are_reported_with_what_to_do(session: Session) -> None:
    assert all("earlier frame" in text for text in reports(session).values())
    shown = looked_at(session, session.state)
    assert shown is not None and "data-pick" not in track_picture(shown, recorded(session))
    count = session.state.notice_count
    session.post(Pick("video", 15, 10.0, 10.0))
    wait_for(lambda: session.state.notice_count > count, "the refusal")
    assert "earlier frame" in session.state.notices[-1].text


def test_without_a_recording_the_closer_look_says_what_to_do_and_not_that_there_are_none(
    run: Path, tmp_path: Path
) -> None:
    kept = Path(shutil.copytree(run, tmp_path / "kept"))
    (kept / "run.rrd").unlink()
    session = opened(tmp_path, kept)
    shown = looked_at(session, session.state)
    assert shown is not None
    text = track_picture(shown, recorded(session))
    assert "<image" in text and "no tracks" not in text and not columns(text)
    assert all("earlier frame" in text for text in reports(session).values())
    session.close(5)


def test_a_recording_alone_is_looked_at_with_its_own_images_and_tracks(run: Path, tmp_path: Path) -> None:
    alone = Path(shutil.copy(run / "run.rrd", tmp_path / "alone.rrd"))
    session = opened(tmp_path, alone)
    for camera in ("video", "left"):
        shown = looked_at(session, session.state.having(Inspection(camera=camera)))
        assert shown is not None and shown.pictured == camera
        text = track_picture(shown, recorded(session))
        assert "<image" in text and columns(text) and "of the recording" in text
    assert all("computed again" in text for text in reports(session).values())
    session.close(5)
