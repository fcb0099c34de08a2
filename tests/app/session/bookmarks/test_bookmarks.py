"""Bookmarks: kept with what they mark, found again, and in the recording."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.events import Bookmark
from ispom_app.features.bookmarks.commands import PutBookmark, RemoveBookmark
from ispom_app.features.bookmarks.notes import change_bookmark, notes_path, put, read_notes
from ispom_app.features.bookmarks.service import Bookmarks
from ispom_app.features.recording.commands import Record, StopRecording
from ispom_app.features.recording.state import Recordings
from ispom_app.session import commands as do
from rerun.chunk import RrdReader

from ispom.errors import InputError
from ispom.io.mapping import read_mapping
from tests import doubles
from tests.app.helpers import started, wait_for


def test_they_are_read_as_they_were_written(tmp_path: Path) -> None:
    sequence, path = doubles.sequence(20), tmp_path / "notes.yaml"
    marks = tuple(Bookmark(i, int(sequence.times_ns[i]), note) for i, note in ((2, ""), (7, "sprünge: 'x' #1 {a}")))
    put(path, bookmarks=marks)
    assert read_notes(path, sequence) == marks
    put(path, bookmarks=())
    assert not path.exists() and read_notes(path, sequence) == ()


def test_where_the_source_is_opened_otherwise_they_stay_at_their_times(tmp_path: Path) -> None:
    sequence, path = doubles.sequence(20), tmp_path / "notes.yaml"
    video = np.flatnonzero(np.array(sequence.kinds) == "video")
    put(path, bookmarks=tuple(Bookmark(i, int(sequence.times_ns[i])) for i in (0, int(video[9]), 21)))
    fewer = sequence.truncated(18)
    fewer = type(fewer)(fewer.name, fewer.rig, fewer.times_ns[video[:15]], ("video",) * 15, fewer.load)
    assert [b.exposure for b in read_notes(path, fewer)] == [0, 9], "the last one is beyond the end"


@pytest.mark.parametrize(
    "text", ["bookmarks: 3", "bookmarks: [{exposure: a, time_ns: 3, note: x}]", "x", "bookmarks: [4]"]
)
def test_a_damaged_file_is_reported_in_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "notes.yaml").write_text(text)
    with pytest.raises(InputError, match=r"notes\.yaml"):
        read_notes(tmp_path / "notes.yaml", doubles.sequence())


def test_each_source_has_its_own_file_and_no_name_leaves_the_folder(tmp_path: Path) -> None:
    sources = ("sim:city", "sim/city", "../../etc/passwd", "/data/kitti/06", "/other/kitti/06", ".." * 60, "")
    paths = {notes_path(None, tmp_path, source) for source in sources}
    assert len(paths) == len(sources) and {path.parent for path in paths} == {tmp_path / "notes"}
    assert notes_path(tmp_path / "run", tmp_path, "x") == tmp_path / "run" / "notes.yaml"
    assert notes_path(tmp_path / "a.rrd", tmp_path, "x") == tmp_path / "a.notes.yaml"


def test_they_are_put_changed_removed_and_there_again_after_a_restart(tmp_path: Path) -> None:
    session = started(tmp_path)
    wait_for(lambda: session.state.ended, "the end")
    for index, note in ((3, None), (8, "  jumps\nhere "), (3, "first")):
        session.post(do.Seek(index))
        session.post(PutBookmark(note))
        wait_for(lambda index=index: session.state.index == index, "the frame")
    session.post(PutBookmark())
    wait_for(
        lambda: [(b.exposure, b.note) for b in session.state[Bookmarks].marks] == [(3, "first"), (8, "jumps here")],
        "both",
    )
    session.post(RemoveBookmark(8))
    session.post(RemoveBookmark(9))
    wait_for(lambda: any("no bookmark at frame 9" in n.text for n in session.state.notices), "the refusal")
    marks = session.state[Bookmarks].marks
    assert [b.exposure for b in marks] == [3]
    session.close(5)
    again = started(tmp_path)
    wait_for(lambda: again.state[Bookmarks].marks == marks, "the bookmarks")
    again.close(5)


def test_they_are_in_the_recording(tmp_path: Path) -> None:
    session = started(tmp_path)
    session.post(Record("marked"))
    wait_for(lambda: session.state.ended, "the end")
    session.post(do.Seek(5))
    session.post(PutBookmark("here"))
    session.post(StopRecording())
    wait_for(lambda: session.state[Recordings].listed, "the file")
    session.close(5)
    found = [
        (batch.column("exposure").to_pylist(), batch.column("TextLog:text").to_pylist())
        for chunk in RrdReader(tmp_path / "marked.rrd").stream().filter(content="/log/bookmarks").to_chunks()
        for batch in [chunk.to_record_batch()]
    ]
    assert found == [([5], [["bookmark: here"]])]


def test_two_apps_on_one_source_keep_what_both_put(tmp_path: Path) -> None:
    first, second = started(tmp_path), started(tmp_path)
    for session in (first, second):
        wait_for(lambda session=session: session.state.ended, "the end")
    for session, index in ((first, 2), (second, 5), (first, 8)):
        session.post(do.Seek(index))
        session.post(PutBookmark(f"at {index}"))
        wait_for(lambda s=session, i=index: i in [b.exposure for b in s.state[Bookmarks].marks], "a bookmark")
    assert [b.exposure for b in first.state[Bookmarks].marks] == [2, 5, 8]
    second.post(RemoveBookmark(5))
    wait_for(lambda: [b.exposure for b in second.state[Bookmarks].marks] == [2, 8], "one less")
    (path,) = (tmp_path / "notes").iterdir()
    assert [b.note for b in read_notes(path, doubles.sequence(20))] == ["at 2", "at 8"]
    assert first.close(5.0) and second.close(5.0)


def test_many_apps_at_once_lose_nothing(tmp_path: Path) -> None:
    sequence, path = doubles.sequence(20), tmp_path / "notes" / "notes.yaml"
    marks = [Bookmark(i, int(sequence.times_ns[i])) for i in range(20)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda mark: change_bookmark(path, sequence, mark.exposure, mark), marks))
    assert read_notes(path, sequence) == tuple(marks)


def test_bookmarks_that_fit_the_source_only_when_it_is_opened_otherwise_stay(tmp_path: Path) -> None:
    sequence, path = doubles.sequence(20), tmp_path / "notes.yaml"
    put(path, note="mine", bookmarks=(Bookmark(3, 12_345),))
    mark = Bookmark(2, int(sequence.times_ns[2]))
    assert change_bookmark(path, sequence, 2, mark) == (mark,)
    assert change_bookmark(path, sequence, 2, None) == ()
    assert read_mapping(path) == {"note": "mine", "bookmarks": [{"exposure": 3, "time_ns": 12_345, "note": ""}]}
