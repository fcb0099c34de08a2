"""The file misses nothing and survives; the live stream never makes the worker wait."""

from __future__ import annotations

import socket
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace

import pytest
import rerun as rr
from ispom_app.rerun_log import blueprint, streams
from ispom_app.run import playback
from rerun.chunk import RrdReader

from ispom.errors import InputError
from ispom.estimators import METHODS, Ensemble
from ispom.types import VideoFrame
from tests import doubles

rr.set_strict_mode(True)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> playback.Playback:
    ensemble = Ensemble(METHODS, {m: doubles.FakeEstimator(m) for m in METHODS})
    monkeypatch.setattr(playback, "build", lambda config, methods, rig: ensemble)
    return playback.Playback(doubles.sequence(), METHODS)


def entities(path: Path) -> set[str]:
    batches = (chunk.to_record_batch() for chunk in RrdReader(path).stream().to_chunks())
    return {batch.schema.metadata[b"rerun:entity_path"].decode() for batch in batches}


def rerun(*arguments: str) -> subprocess.CompletedProcess:
    program = Path(sysconfig.get_path("scripts")) / ("rerun.exe" if sys.platform == "win32" else "rerun")
    return subprocess.run([program, *arguments], capture_output=True, text=True, timeout=60, check=False)


def test_a_closed_file_verifies(run, tmp_path):
    file = streams.FileRecording(tmp_path / "new" / "run.rrd", run.opened)
    while not run.done:
        file.write(run.step())
    file.write(run.finish())
    file.close()
    file.close()
    verified = rerun("rrd", "verify", str(file.path))
    assert verified.returncode == 0, verified.stderr
    assert file.failure is None and file.size_bytes == file.path.stat().st_size > 10_000


def test_an_unclosed_file_is_readable(run, tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "FLUSH_EVERY", 1)
    file = streams.FileRecording(tmp_path / "run.rrd", run.opened)
    file.write(run.step())
    copy = tmp_path / "copy.rrd"
    copy.write_bytes(file.path.read_bytes())
    assert "/video/image" in entities(copy) and "/world/truth/path" in entities(copy)
    file.close()


def test_an_unwritable_path_says_so(run, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="choose another folder"):
        streams.FileRecording(tmp_path / "file" / "run.rrd", run.opened)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full, a disk without space")
def test_a_full_disk_says_so(run, tmp_path):
    (tmp_path / "run.rrd").symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"run\.rrd.*No space left"):
        streams.FileRecording(tmp_path / "run.rrd", run.opened)


@pytest.mark.parametrize(("free", "said"), [(0, "the disk is full"), (10**9, "the pen broke")])
def test_a_disk_that_fills_up_ends_the_recording_and_not_the_run(run, tmp_path, monkeypatch, free, said):
    def no_more(*_, **__):
        raise RuntimeError("the pen broke")

    file = streams.FileRecording(tmp_path / "run.rrd", run.opened)
    for _ in range(streams.FLUSH_EVERY):
        file.write(run.step())
    monkeypatch.setattr(rr.RecordingStream, "flush", no_more)
    monkeypatch.setattr(streams.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    for _ in range(streams.FLUSH_EVERY):
        file.write(run.step())
    assert file.failure is not None and "run.rrd" in file.failure and said in file.failure
    file.write(run.step())
    file.close()
    assert "/video/image" in entities(file.path)


def test_a_reader_that_never_comes_costs_pictures_only(run):
    mailbox = streams.Mailbox(pictures=3)
    while not run.done:
        mailbox.put(run.step())
    count = len(run.sequence)
    assert mailbox.dropped == count - 3
    events = [mailbox.take() for _ in range(count)]
    assert [e.index for e in events] == list(range(count))  # type: ignore[union-attr]
    sizes = [e.exposure.image.size for e in events if isinstance(e.exposure, VideoFrame)]  # type: ignore[union-attr]
    assert sizes[0] == 0 and sizes[-1] > 0
    mailbox.close()
    assert mailbox.take() is None


def test_the_live_stream_hands_over_without_waiting(run, monkeypatch):
    """The sender is stuck for good: `write`, another `open` and `close` return all the same."""
    monkeypatch.setattr(streams.LiveStream, "_run", lambda *_: streams.threading.Event().wait())
    live = streams.LiveStream()
    live.open(run.opened)
    while not run.done:
        live.write(run.step())
    assert live.dropped == max(0, len(run.sequence) - streams.PICTURES_WAITING)
    live.open(run.opened)
    live.write(run.finish())
    live.close()


def test_the_live_stream_listens_on_this_machine_only(run):
    live = streams.LiveStream()
    assert live.url == f"rerun+http://127.0.0.1:{live.port}/proxy"
    with socket.create_connection(("127.0.0.1", live.port), timeout=10) as connection:
        assert connection.getpeername()[0] == "127.0.0.1"
    with socket.socket() as other:
        other.settimeout(2)
        assert other.connect_ex(("127.0.0.2", live.port)) != 0
    live.close()


def test_events_without_pictures_are_recorded_too(run, tmp_path):
    with streams.FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            file.write(streams.without_images(run.step()))
    found = entities(tmp_path / "run.rrd")
    assert "/video/image" not in found and {"/world/stereo/path/0", "/decisions"} <= found


@pytest.mark.parametrize("hidden", [(), ("clouds", "monocular", "trails")])
def test_the_layout_can_be_made_for_every_rig(run, hidden):
    assert blueprint.blueprint(run.opened, hidden) is not None
