"""The live stream never makes the worker wait; any number of readers take the run from its tape at their own pace."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import rerun as rr
from ispom_app.rerun_log import blueprint, live, rrd, tape
from ispom_app.rerun_log.recorder import Recorder
from ispom_app.rerun_log.stored_tape import StoredTape
from ispom_app.run.events import Stepped
from ispom_app.run.history.feed import IMAGES_WAITING
from ispom_app.run.history.history import History
from ispom_app.run.history.record import ExposureRecord
from ispom_app.run.playback import Playback
from rerun.chunk import RrdReader

from tests import doubles
from tests.alone import METHODS
from tests.app import helpers

rr.set_strict_mode(True)
ALL = 1 << 40


@pytest.fixture
def run() -> Playback:
    return Playback(doubles.sequence(), METHODS, builder=helpers.build)


@pytest.fixture
def history() -> History:
    return History()


def stepped(run: Playback, history: History) -> Stepped:
    """The next exposure, as the session keeps it before it tells of it."""
    event = run.step()
    history.append(ExposureRecord.of(event, history.last))
    return event


@pytest.fixture
def stream(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[live.LiveStream]:
    monkeypatch.setattr(tape, "user_cache_path", lambda _: tmp_path)
    found = live.LiveStream()
    yield found
    found.close()


def index_counts(content: bytes, folder: Path) -> dict[str, int]:
    """Rows of each entity in a reader's bytes."""
    path = folder / "read.rrd"
    path.write_bytes(rrd.HEADER + content)
    counts: dict[str, int] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        name = batch.schema.metadata[b"rerun:entity_path"].decode()
        counts[name] = counts.get(name, 0) + batch.num_rows
    return counts


def shown(found: live.LiveStream, run: Playback) -> bytes:
    """The whole run, as a reader has it at the end."""
    assert found.tape is not None
    content, at = b"", 0
    while b"/world/stereo/final" not in content:
        more, at = found.tape.read(at, ALL)
        content += more
    return content


def test_a_reader_that_comes_late_gets_the_run_from_its_beginning(run, stream, history, tmp_path):
    stream.open(run.opened, history)
    steps = 0
    while not run.done:
        stream.write(stepped(run, history))
        steps += 1
        helpers.wait_for(lambda: stream._feed.empty, "the thread to follow")
    stream.write(run.finish())
    counts = index_counts(shown(stream, run), tmp_path)
    assert counts["/decisions"] == steps
    assert counts["/video/image"] + counts["/left/image"] == steps
    assert counts["/world/truth/path"] == 1


def test_readers_are_told_of_more_and_of_another_run(run, stream, history):
    rung: list[object] = []
    stream.grown.add(lambda: rung.append(stream.tape))
    stream.open(run.opened, history)
    first = stream.tape
    helpers.wait_for(lambda: rung.count(first) >= 2, "the opening to be on the tape")
    stream.open(run.opened, history)
    assert stream.tape is not first and stream.tape.run != first.run
    assert first.read(0, ALL) == (b"", 0)


def test_the_live_stream_hands_over_without_waiting(run, stream, history, monkeypatch):
    """Its thread is stuck for good: `write`, another `open` and `close` return all the same."""
    monkeypatch.setattr(live.LiveStream, "_run", lambda *_: live.threading.Event().wait())
    stream.open(run.opened, history)
    while not run.done:
        stream.write(stepped(run, history))
    assert stream.dropped == max(0, len(run.sequence) - IMAGES_WAITING)
    stream.open(run.opened, history)
    stream.write(run.finish())
    stream.close()


def test_a_fault_of_the_live_thread_is_said_to_who_feeds_it(run, stream, history, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(tape.Tape, "append", full)
        stream.open(run.opened, history)
        helpers.wait_for(lambda: stream._failure, "the fault")
        with pytest.raises(RuntimeError, match="No space left"):
            stream.write(stepped(run, history))
    stream.open(run.opened, history)
    stream.write(stepped(run, history))


def test_nothing_listens_for_the_live_stream(run, stream, history):
    """Another program on this machine can neither read it nor write to it."""
    me = psutil.Process()
    before = {c.laddr for c in me.net_connections("inet") if c.status == psutil.CONN_LISTEN}
    stream.open(run.opened, history)
    stream.write(stepped(run, history))
    helpers.wait_for(lambda: stream._feed.empty and stream.tape._items, "the first exposure on the tape")
    assert {c.laddr for c in me.net_connections("inet") if c.status == psutil.CONN_LISTEN} == before


@pytest.mark.parametrize("hidden", [(), ("clouds", "monocular", "trails")])
def test_the_layout_can_be_made(run, hidden):
    assert blueprint.blueprint(run.opened, hidden) is not None


def test_old_images_leave_the_disk_and_all_else_stays(tmp_path):
    found = tape.Tape(tmp_path, image_bytes=1000)
    for i in range(100):
        found.append(b"%02d" % i, b"i" * 100)
    content, after = found.read(0, ALL)
    assert after == 100 and content.replace(b"i", b"") == b"".join(b"%02d" % i for i in range(100))
    assert 500 <= content.count(b"i") <= 1000
    assert content.endswith(b"i" * 100)
    found.close()


def test_a_tape_is_read_in_pieces(tmp_path):
    found = tape.Tape(tmp_path)
    for i in range(10):
        found.append(b"%d" % i, b"")
    assert found.read(0, 3) == (b"012", 3)
    assert found.read(3, 100) == (b"3456789", 10)
    assert found.read(10, 100) == (b"", 10)
    found.close()


def test_the_files_of_a_tape_have_no_name(tmp_path):
    """Nothing is left of them, however the process ends."""
    found = tape.Tape(tmp_path)
    found.append(b"x", b"y")
    assert not list(tmp_path.iterdir())
    found.close()


def test_several_files_are_read_as_one_recording(tmp_path):
    """A run's, and that of its map beside it."""
    for name, values in (("run", (1.0, 2.0)), ("map", (3.0,))):
        recording = rr.RecordingStream("ispom", recording_id="same")
        recording.save(tmp_path / f"{name}.rrd")
        for value in values:
            recording.log(f"{name}/value", rr.Scalars([value]), static=True)
            recording.flush()
        recording.disconnect()
    found = StoredTape(tmp_path / "run.rrd", tmp_path / "map.rrd")
    content, at = b"", 0
    while True:
        piece, after = found.read(at, 50)
        if after == at:
            break
        content, at = content + piece, after
    (tmp_path / "both.rrd").write_bytes(rrd.HEADER + content)
    paths = {chunk.entity_path for chunk in RrdReader(tmp_path / "both.rrd").stream().to_chunks()}
    assert {"/run/value", "/map/value"} <= paths
    found.close()
    assert found.read(0, ALL) == (b"", 0)


def test_streams_are_joined_to_one_that_rerun_reads(tmp_path):
    recording = rr.RecordingStream("ispom", recording_id="joined")
    binary, content = rr.binary_stream(recording), b""
    for i in range(5):
        recording.set_time("exposure", sequence=i)
        recording.log("value", rr.Scalars([float(i)]))
        content += rrd.messages(binary.read(flush_timeout_sec=5))
    assert index_counts(content, tmp_path)["/value"] == 5
    assert rrd.messages(binary.read(flush_timeout_sec=5)) == b""


def test_a_run_that_is_left_half_way_says_nothing_on_the_terminal(run, capfd):
    recorder = Recorder(run.opened)
    with live._Encoder(recorder) as encoder:
        encoder.send(recorder.opening())
    del encoder
    gc.collect()
    assert not capfd.readouterr().err


def test_of_a_run_that_is_shown_again_the_exposure_looked_at_has_its_picture(run, stream, history, tmp_path):
    while not run.done:
        stepped(run, history)
    stream.open(run.opened, history)
    stream.look_at(7)
    camera = "left" if run.opened.sequence.kinds[7] == "stereo" else "video"
    content, at, counts = b"", 0, dict[str, int]()
    while f"/{camera}/image" not in counts:
        more, at = stream.tape.read(at, ALL)
        content += more
        counts = index_counts(content, tmp_path) if b"/image" in content else {}
    assert counts[f"/{camera}/image"] == 1 and counts[f"/{camera}/tracks"] == 1
