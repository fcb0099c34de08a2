"""The file misses nothing and survives."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace

import pytest
import rerun as rr
from ispom_app.rerun_log import file_recording
from ispom_app.run.events import without_images
from ispom_app.run.playback import Playback
from rerun.chunk import RrdReader

from ispom.errors import InputError
from ispom.estimators import METHODS
from tests import doubles
from tests.app import helpers

rr.set_strict_mode(True)


@pytest.fixture
def run() -> Playback:
    return Playback(doubles.sequence(), METHODS, builder=helpers.build)


def entities(path: Path) -> set[str]:
    batches = (chunk.to_record_batch() for chunk in RrdReader(path).stream().to_chunks())
    return {batch.schema.metadata[b"rerun:entity_path"].decode() for batch in batches}


def rerun(*arguments: str) -> subprocess.CompletedProcess:
    program = Path(sysconfig.get_path("scripts")) / ("rerun.exe" if sys.platform == "win32" else "rerun")
    return subprocess.run([program, *arguments], capture_output=True, text=True, timeout=60, check=False)


def test_a_closed_file_verifies(run, tmp_path):
    file = file_recording.FileRecording(tmp_path / "new" / "run.rrd", run.opened)
    while not run.done:
        file.write(run.step())
    file.write(run.finish())
    file.close()
    file.close()
    verified = rerun("rrd", "verify", str(file.path))
    assert verified.returncode == 0, verified.stderr
    assert file.failure is None and file.size_bytes == file.path.stat().st_size > 10_000


def test_an_unclosed_file_is_readable(run, tmp_path, monkeypatch):
    monkeypatch.setattr(file_recording, "FLUSH_EVERY", 1)
    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    file.write(run.step())
    copy = tmp_path / "copy.rrd"
    copy.write_bytes(file.path.read_bytes())
    assert "/video/image" in entities(copy) and "/world/truth/path" in entities(copy)
    file.close()


def test_an_unwritable_path_says_so(run, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="choose another folder"):
        file_recording.FileRecording(tmp_path / "file" / "run.rrd", run.opened)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full, a disk without space")
def test_a_full_disk_says_so(run, tmp_path):
    (tmp_path / "run.rrd").symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"run\.rrd.*No space left"):
        file_recording.FileRecording(tmp_path / "run.rrd", run.opened)


@pytest.mark.parametrize(("free", "said"), [(0, "the disk is full"), (10**9, "the pen broke")])
def test_a_disk_that_fills_up_ends_the_recording_and_not_the_run(run, tmp_path, monkeypatch, free, said):
    def no_more(*_, **__):
        raise RuntimeError("the pen broke")

    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    for _ in range(file_recording.FLUSH_EVERY):
        file.write(run.step())
    monkeypatch.setattr(rr.RecordingStream, "flush", no_more)
    monkeypatch.setattr(file_recording.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    for _ in range(file_recording.FLUSH_EVERY):
        file.write(run.step())
    assert file.failure is not None and "run.rrd" in file.failure and said in file.failure
    file.write(run.step())
    file.close()
    assert "/video/image" in entities(file.path)


def test_events_without_pictures_are_recorded_too(run, tmp_path):
    with file_recording.FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            file.write(without_images(run.step()))
    found = entities(tmp_path / "run.rrd")
    assert "/video/image" not in found and {"/world/stereo/path/0", "/decisions"} <= found
