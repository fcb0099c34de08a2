"""The live stream never makes the worker wait; any number of readers take the run from its tape at their own pace."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import psutil
import pyarrow as pa
import pytest
import rerun as rr
from ispom_app.engine.events import Stepped
from ispom_app.engine.history.feed import IMAGES_WAITING
from ispom_app.engine.history.history import History
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.playback import Playback
from ispom_app.views.rerun import blueprint, entities, live, rrd, tape
from ispom_app.views.rerun.file_recording import FileRecording
from ispom_app.views.rerun.parts import STAGE, SceneSource, SceneWriter, columns_of, latest_of_each_camera
from ispom_app.views.rerun.recorder import Recorder
from ispom_app.views.rerun.stored_tape import StoredTape
from rerun.chunk import RrdReader

from ispom.types import Measurement, is_stereo
from tests.app import helpers

rr.set_strict_mode(True)


@pytest.fixture
def history() -> History:
    return History()


def stepped(run: Playback, history: History) -> Stepped:
    """The next frame, as the session keeps it before it tells of it."""
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


def test_a_reader_that_comes_late_gets_the_opening_and_any_frame(run, stream, history, tmp_path):
    stream.open(run.opened, history)
    while not run.done:
        stream.write(stepped(run, history))
        helpers.wait_for(lambda: stream._feed.empty, "the thread to follow")
    stream.write(run.finish())
    counts = index_counts(stream.tape.opening(), tmp_path)
    assert counts["/world/truth/path"] == 1 and not counts.keys() & {"/decisions", "/video/image", "/left/tracks"}
    helpers.wait_for(lambda: stream.tape.end == len(run.sequence), "the last frame")
    for index in (3, 17, 0, len(run.sequence) - 1):
        assert_drawn(stream.tape, run, index, tmp_path)


def drawn(source: SceneSource, index: int, folder: Path) -> dict[str, pa.RecordBatch]:
    """What a viewer that held another frame before has of this one, by entity; of what it lost an empty value."""
    writer = SceneWriter(source)
    content = b"".join(writer.write(source.scene(each), serial) for serial, each in enumerate((source.end - 1, index)))
    writer.close()
    path = folder / "drawn.rrd"
    path.write_bytes(rrd.HEADER + content)
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        assert chunk.is_static or chunk.entity_path == f"/{STAGE}"
        found[chunk.entity_path] = chunk.to_record_batch()  # of several the last counts
    return found


def assert_drawn(source: SceneSource, run: Playback, index: int, folder: Path) -> None:
    """The images are those of the frame, and of the other camera's latest one."""
    found, sequence = drawn(source, index, folder), run.opened.sequence
    for camera, frame in latest_of_each_camera(sequence.kinds, index).items():
        exposure = sequence[frame]
        pixels = np.array(found[f"/{camera}/image"].column("Image:buffer")[0].values[0].values, np.uint8)
        others = [i for i, kind in enumerate(sequence.kinds) if kind == sequence.kinds[frame] and i != frame]
        assert all(distance(pixels, sequence[i], camera) > 3 * distance(pixels, exposure, camera) for i in others)
        assert len(found[f"/{camera}/tracks"].column("Points2D:positions")[0]) > 0


def distance(pixels: np.ndarray, exposure: Measurement, camera: str) -> float:
    """Mean difference of brightness: of colours that are noise, JPEG keeps little."""
    stereo = is_stereo(exposure)
    image = exposure.image if not stereo else exposure.left if camera == "left" else exposure.right
    drawn, own = (cv2.cvtColor(each, cv2.COLOR_RGB2GRAY).astype(int) for each in (pixels.reshape(image.shape), image))
    return float(np.abs(drawn - own).mean())


def test_readers_are_notified_of_more_and_of_another_run(run, stream, history):
    rung: list[object] = []
    stream.grown.add(lambda: rung.append(stream.tape))
    stream.open(run.opened, history)
    first = stream.tape
    helpers.wait_for(lambda: rung.count(first) >= 2, "the opening to be on the tape")
    assert first.opening()
    stream.open(run.opened, history)
    assert stream.tape is not first and stream.tape.run != first.run
    assert first.opening() == b""


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


def test_a_fault_of_the_live_thread_is_raised_in_its_caller(run, stream, history, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(tape.Tape, "put", full)
        stream.open(run.opened, history)
        stream.write(stepped(run, history))
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
    helpers.wait_for(lambda: stream.tape.end, "the first frame on the tape")
    assert {c.laddr for c in me.net_connections("inet") if c.status == psutil.CONN_LISTEN} == before


@pytest.mark.parametrize("hidden", [(), ("clouds", "monocular", "trails")])
def test_the_layout_can_be_made(run, hidden):
    assert blueprint.blueprint(run.opened, hidden) is not None


def image(value: int) -> pa.RecordBatch:
    """The columns of an image that is this bright."""
    return columns_of("video/image", entities.jpeg(np.full((8, 8), value, np.uint8)))


def test_an_image_that_left_the_disk_is_missed_and_requested_and_all_else_stays(tmp_path):
    requested: list[int] = []
    found = tape.Tape(tmp_path, image_bytes=20_000, kinds=lambda: ("video",) * 100, request=requested.append)
    for i in range(100):
        found.put(i, "video/image", image(i))
        found.put(i, "video/tracks", columns_of("video/tracks", rr.Points2D([[i, i]])))
        found.came(i)
    scenes = [found.scene(i) for i in range(100)]
    assert scenes[0].missing and not scenes[-1].missing and 5 < sum(not s.missing for s in scenes) < 20
    assert scenes[0].versions.keys() == {("video/tracks", "Points2D")}, "no other frame's image"
    found.request(0)
    assert requested == [0]
    found.put(0, "video/image", image(0))
    assert not found.scene(0).missing
    found.close()


def test_a_frame_without_its_image_never_has_anothers(tmp_path):
    found = tape.Tape(tmp_path, kinds=lambda: ("video", "stereo", "video", "video"))
    for i, path in enumerate(("video/image", "left/image", "video/image", "")):
        if path:
            found.put(i, path, columns_of(path, entities.jpeg(np.full((8, 8), i, np.uint8))))
        found.came(i, bare=not path)
    assert {path for path, _ in found.scene(2).versions} == {"video/image", "left/image"}
    scene = found.scene(3)
    assert scene.missing and {path for path, _ in scene.versions} == {"left/image"}
    found.came(3)
    assert not found.scene(3).missing, "it cannot be read"
    found.close()


def test_what_was_cleared_is_not_shown_until_it_is_logged_again(tmp_path):
    found, pose = tape.Tape(tmp_path, kinds=lambda: ("video",) * 6), rr.Transform3D(translation=[0, 0, 0])
    for i, value in enumerate((pose, rr.Clear(recursive=False), None, pose, None, None)):
        if value is not None:
            found.put(i, "world/stereo/camera", columns_of("world/stereo/camera", value))
        found.came(i)
    assert [bool(found.scene(i).versions) for i in range(6)] == [True, False, False, True, True, True]
    found.close()


def test_a_viewer_gets_what_changed_and_loses_what_is_not_there_any_more(tmp_path):
    found = tape.Tape(tmp_path, kinds=lambda: ("video",) * 3)
    for i in range(3):
        found.put(i, "decisions", columns_of("decisions", rr.TextDocument(str(i))))
        if i != 1:
            found.put(
                i, "world/stereo/cloud/0", columns_of("world/stereo/cloud/0", rr.Points3D(np.full((i + 1, 3), i)))
            )
        if i == 2:
            found.put(i, "world/stereo/cloud/1", columns_of("world/stereo/cloud/1", rr.Points3D([[0, 0, 0]])))
        found.came(i)
    writer = SceneWriter(found)
    content, sent, before = b"", list[set[str]](), dict[str, int]()
    for serial, index in enumerate((2, 2, 1, 0)):
        content += writer.write(found.scene(index), serial)
        counts = index_counts(content, tmp_path)
        sent.append({path for path in counts if counts[path] > before.get(path, 0) and path != f"/{STAGE}"})
        before = counts
    both = {"/world/stereo/cloud/0", "/world/stereo/cloud/1"}
    assert sent == [both | {"/decisions"}, set(), both | {"/decisions"}, {"/decisions"}]
    assert not writer.differs(found.scene(0)) and writer.differs(found.scene(2))
    writer.close()
    back = drawn(found, 1, tmp_path)
    assert len(back["/world/stereo/cloud/0"].column("Points3D:positions")[0]) == 1
    assert len(back["/world/stereo/cloud/1"].column("Points3D:positions")[0]) == 0
    assert back["/decisions"].column("TextDocument:text")[0].as_py() == ["1"]
    found.close()


def test_a_viewer_that_comes_back_loses_what_nobody_knows_that_it_has(tmp_path):
    found = tape.Tape(tmp_path, kinds=lambda: ("video",) * 2)
    for i in range(2):
        found.put(i, f"world/stereo/cloud/{i}", columns_of(f"world/stereo/cloud/{i}", rr.Points3D([[i, i, i]])))
        found.came(i)
    writer = SceneWriter(found, fresh=False)
    assert writer.differs(found.scene(0))
    counts = index_counts(writer.write(found.scene(0), 7), tmp_path)
    assert counts == {"/world/stereo/cloud/0": 1, "/world/stereo/cloud/1": 1, f"/{STAGE}": 1}
    writer.close()
    found.close()


def test_the_files_of_a_tape_have_no_name(tmp_path):
    """Nothing is left of them, however the process ends."""
    found = tape.Tape(tmp_path)
    found.put(0, "video/image", image(0))
    assert not list(tmp_path.iterdir())
    found.close()


def test_any_frame_of_a_finished_recording_can_be_drawn(run, tmp_path):
    opened = run.opened
    with FileRecording(tmp_path / "run.rrd", opened) as file:
        while not run.done:
            file.write(run.step())
        file.write(run.finish())
    found = StoredTape(tmp_path / "run.rrd", kinds=run.opened.sequence.kinds)
    assert found.end == len(run.sequence) and found.recording_id == opened.recording_id
    for index in (3, 17, 0, found.end - 1):
        assert_drawn(found, run, index, tmp_path)
        assert not found.scene(index).missing
    counts = index_counts(found.opening(), tmp_path)
    assert not counts.keys() & {"/decisions", "/video/image", "/left/tracks", "/world/stereo/camera"}
    assert counts.keys() >= {"/world/truth/path", "/video"}
    found.close()
    assert not found.scene(0).versions and found.opening() == b""


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
    (tmp_path / "both.rrd").write_bytes(rrd.HEADER + found.opening())
    paths = {chunk.entity_path for chunk in RrdReader(tmp_path / "both.rrd").stream().to_chunks()}
    assert {"/run/value", "/map/value"} <= paths
    found.close()
    assert found.opening() == b""


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
    assert live._opening(Recorder(run.opened))
    gc.collect()
    assert not capfd.readouterr().err


def test_of_a_run_that_is_shown_again_the_frame_looked_at_has_its_image(run, stream, history, tmp_path):
    while not run.done:
        stepped(run, history)
    stream.open(run.opened, history)
    helpers.wait_for(lambda: stream.tape.end == len(run.sequence), "all frames")
    assert stream.tape.scene(7).missing
    stream.tape.request(7)
    helpers.wait_for(lambda: not stream.tape.scene(7).missing, "its images")
    assert_drawn(stream.tape, run, 7, tmp_path)
    assert stream.tape.scene(9).missing
