"""The file misses nothing and survives."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import sysconfig
from dataclasses import replace
from io import FileIO
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest
import rerun as rr
from ispom_app.engine.events import blank
from ispom_app.views.rerun import file_recording, piped_file
from ispom_app.views.rerun.piped_file import PipedFile
from ispom_app.views.rerun.rrd import is_finished, whole_bytes

from ispom.errors import InputError
from ispom.io import whole
from ispom.io.whole import part_of
from tests.app.recorded import entities_in, exposures_in

rr.set_strict_mode(True)


def rerun(*arguments: str) -> subprocess.CompletedProcess:
    program = Path(sysconfig.get_path("scripts")) / ("rerun.exe" if sys.platform == "win32" else "rerun")
    return subprocess.run([program, *arguments], capture_output=True, text=True, timeout=60, check=False)


def full_after(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """A disk with room for `count` bytes. Of a piece that is too large it writes the part that fits."""
    room = [count]

    class Full(FileIO):
        def write(self, piece) -> int:
            if not room[0]:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            taken = super().write(piece[: room[0]])
            room[0] -= taken
            return taken

    monkeypatch.setattr(whole, "FileIO", Full)


def test_a_closed_file_verifies(run, tmp_path):
    file = file_recording.FileRecording(tmp_path / "new" / "run.rrd", run.opened)
    while not run.done:
        file.write(run.step())
    file.write(run.finish())
    file.close()
    file.close()
    assert file.failure is None and file.size_bytes == file.path.stat().st_size > 10_000
    verified = rerun("rrd", "verify", str(file.path))
    if "shared libraries" in verified.stderr:
        pytest.skip(f"Rerun's own program does not start here: {verified.stderr.strip()}")
    assert verified.returncode == 0, verified.stderr


def test_its_size_is_known_in_the_moment_in_which_it_gets_its_name(run, tmp_path, monkeypatch):
    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    hidden, stat, exists = part_of(file.path), Path.stat, Path.exists

    def closing(look):
        def looked(path: Path, **how):
            found = look(path, **how)
            if path == hidden:
                monkeypatch.undo()
                file.close()
            return found

        return looked

    monkeypatch.setattr(Path, "stat", closing(stat))
    monkeypatch.setattr(Path, "exists", closing(exists))
    assert file.size_bytes > 0
    assert file.size_bytes == file.path.stat().st_size


def test_every_exposure_is_readable_while_the_file_grows(run, tmp_path, monkeypatch):
    monkeypatch.setattr(file_recording, "FLUSH_EVERY", 1)
    monkeypatch.setattr(file_recording, "WAIT_S", 60.0)
    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    file.write(run.step())
    (part,) = tmp_path.glob("*.rrd")
    copy = tmp_path / "copy.rrd"
    copy.write_bytes(part.read_bytes())
    assert part == part_of(file.path) and not is_finished(part) and whole_bytes(part) == file.size_bytes
    assert "/video/image" in entities_in(copy) and "/world/truth/path" in entities_in(copy)
    file.close()
    assert is_finished(file.path) and [path.name for path in sorted(tmp_path.iterdir())] == ["copy.rrd", "run.rrd"]


def test_a_flush_waits_for_a_slow_disk(run, tmp_path, monkeypatch):
    class Slow(FileIO):
        def write(self, piece) -> int:
            Event().wait(0.05)
            return super().write(piece)

    monkeypatch.setattr(whole, "FileIO", Slow)
    monkeypatch.setattr(file_recording, "FLUSH_EVERY", 1)
    monkeypatch.setattr(file_recording, "WAIT_S", 60.0)
    with file_recording.FileRecording(tmp_path / "run.rrd", run.opened) as file:
        for exposure in range(3):
            file.write(run.step())
            assert exposures_in(part_of(file.path)) == set(range(exposure + 1))


def test_without_pipes_as_on_windows_the_file_is_whole_and_has_its_name(run, tmp_path, monkeypatch):
    for module in (piped_file, file_recording):
        monkeypatch.setattr(module, "PIPES", False)
    with file_recording.FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            file.write(run.step())
    assert file.failure is None and is_finished(file.path) and file.size_bytes == file.path.stat().st_size
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"] and "/video/image" in entities_in(file.path)


def test_two_writers_never_share_a_recording(run, tmp_path):
    with (
        file_recording.FileRecording(tmp_path / "run.rrd", run.opened),
        pytest.raises(InputError, match="by another run"),
    ):
        file_recording.FileRecording(tmp_path / "run.rrd", run.opened)


def test_an_unfinished_recording_is_not_overwritten(run, tmp_path):
    part_of(tmp_path / "run.rrd").write_bytes(b"what a killed run left")
    with pytest.raises(InputError, match="ispom repair"):
        file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    assert part_of(tmp_path / "run.rrd").read_bytes() == b"what a killed run left"


def test_an_unwritable_path_says_so(run, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match="choose another folder"):
        file_recording.FileRecording(tmp_path / "file" / "run.rrd", run.opened)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full, a disk without space")
def test_a_full_disk_never_makes_the_writer_wait(tmp_path, monkeypatch):
    monkeypatch.setattr(piped_file, "create_file", lambda _: FileIO("/dev/full", "wb"))
    file = PipedFile(tmp_path / "run.rrd")
    with open(file.target, "wb", buffering=0) as pipe:
        file.opened()
        for _ in range(100):
            pipe.write(bytes(1 << 16))
    assert file.ended(20.0) and file.failure is not None and file.failure.errno == errno.ENOSPC


@pytest.mark.parametrize("kilobytes", [160, 250, 320])
def test_a_disk_that_fills_up_ends_the_recording_and_not_the_run(run, tmp_path, monkeypatch, kilobytes):
    monkeypatch.setattr(file_recording, "RESERVE_BYTES", 0)
    full_after(monkeypatch, kilobytes * 1000)
    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    while not run.done:
        file.write(run.step())
    file.close()
    assert file.failure == f"{file.path} ends early because the disk is full: free some space and record again"
    assert whole_bytes(file.path) == file.size_bytes <= kilobytes * 1000
    assert "/video" in entities_in(file.path)


def test_a_disk_that_does_not_answer_is_waited_for_no_longer_than_requested(run, tmp_path, monkeypatch):
    gone, answer = Event(), Event()

    class Stalled(FileIO):
        def write(self, piece) -> int:
            if gone.is_set():
                answer.wait()
            return super().write(piece)

    monkeypatch.setattr(whole, "FileIO", Stalled)
    monkeypatch.setattr(file_recording, "CLOSE_S", 1e9)
    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    gone.set()
    file.write(run.step())
    file.close(lambda: True)
    answer.set()
    assert file.failure is not None and "not answer" in file.failure


def test_a_recording_leaves_room_for_the_results(run, tmp_path, monkeypatch):
    file = file_recording.FileRecording(tmp_path / "run.rrd", run.opened)
    for _ in range(file_recording.FLUSH_EVERY):
        file.write(run.step())
    monkeypatch.setattr(file_recording.shutil, "disk_usage", lambda _: SimpleNamespace(free=10_000_000))
    for _ in range(file_recording.FLUSH_EVERY):
        file.write(run.step())
    assert file.failure is not None and "run.rrd" in file.failure and "disk is full" in file.failure
    file.write(run.step())
    file.close()
    assert is_finished(file.path) and "/video/image" in entities_in(file.path)


def test_events_without_pictures_are_recorded_too(run, tmp_path):
    with file_recording.FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            event = run.step()
            file.write(replace(event, exposure=blank(run.sequence, event.index)))
    found = entities_in(tmp_path / "run.rrd")
    assert "/video/image" not in found and {"/world/stereo/path/0", "/decisions"} <= found
