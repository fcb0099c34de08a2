"""A run writes into its own folder only: never over a person's files, a complete run, or a run that goes on."""

from __future__ import annotations

import multiprocessing
import os
import signal
from io import FileIO
from pathlib import Path

import pytest
from ispom_app.engine.run_folder.run_folder import MARKER, RunFolder, is_incomplete

from ispom.errors import InputError
from ispom.io import whole
from tests.app.helpers import files_of


def incomplete(path: Path) -> Path:
    with RunFolder(path) as folder:
        folder.write("run.yaml", "source: x\n")
        folder.write("stereo.tum", "")
        folder.part("poses.csv").touch()
    return path


@pytest.mark.parametrize(
    "names", [("rig.yaml",), ("truth.tum",), ("rig.yaml", "sequence.yaml"), (MARKER,), (".part-x",), ("run.rrd",)]
)
def test_a_folder_with_anything_in_it_is_not_written_to(names: tuple[str, ...], tmp_path: Path) -> None:
    for name in names:
        (tmp_path / name).write_text(f"{name} of a person")
    before = files_of(tmp_path)
    with pytest.raises(InputError, match="is not empty"):
        RunFolder(tmp_path)
    assert files_of(tmp_path) == before


@pytest.mark.parametrize("name", ["notes.txt", "sequence.yaml", "export"])
def test_a_file_added_to_an_incomplete_run_keeps_all_of_it(name: str, tmp_path: Path) -> None:
    incomplete(tmp_path)
    (tmp_path / "export").mkdir() if name == "export" else (tmp_path / name).touch()
    with pytest.raises(InputError, match=f"incomplete run .{name}"):
        RunFolder(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {MARKER, "run.yaml", "stereo.tum", ".part-poses.csv", name}


def test_an_incomplete_run_is_replaced(tmp_path: Path) -> None:
    assert is_incomplete(incomplete(tmp_path))
    with RunFolder(tmp_path) as folder:
        assert {path.name for path in tmp_path.iterdir()} == {MARKER, ".lock"}
        folder.write("run.yaml", "")
        folder.complete()
    assert not is_incomplete(tmp_path)
    with pytest.raises(InputError, match="holds a complete run"):
        RunFolder(tmp_path)


def test_two_runs_never_share_a_folder(tmp_path: Path) -> None:
    with RunFolder(tmp_path), pytest.raises(InputError, match="by another run"):
        RunFolder(tmp_path)
    with RunFolder(tmp_path):
        pass


def _claim_and_die(path: Path) -> None:
    with RunFolder(path):
        os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no SIGKILL")
def test_the_lock_of_a_killed_run_is_nobodys(tmp_path: Path) -> None:
    process = multiprocessing.get_context("spawn").Process(target=_claim_and_die, args=(tmp_path,))
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL and (tmp_path / ".lock").exists() and is_incomplete(tmp_path)
    with RunFolder(tmp_path):
        pass


@pytest.mark.timeout(20)
def test_a_link_to_nothing_in_place_of_the_recordings_is_reported(tmp_path: Path) -> None:
    """All names in it seemed to be taken, for ever."""
    (tmp_path / "recordings").symlink_to("/nowhere/recordings")
    with pytest.raises(InputError, match="recordings is a link to /nowhere/recordings"):
        RunFolder.new(tmp_path / "recordings" / "city")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"city cannot be created"):
        RunFolder.new(tmp_path / "file" / "city")


def test_the_same_name_in_the_same_second_is_given_once(tmp_path: Path) -> None:
    with RunFolder.new(tmp_path / "city") as first, RunFolder.new(tmp_path / "city") as second:
        assert [first.path.name, second.path.name] == ["city", "city-2"]


@pytest.mark.parametrize("name", ["x" * 300, "nul\0", "file", "file/inside"])
def test_a_place_that_cannot_be_a_folder_is_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    with pytest.raises(InputError, match=r"cannot be created"):
        RunFolder(tmp_path / name)
    assert (tmp_path / "file").read_text() == "kept"


def test_files_that_do_not_fit_are_named_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with RunFolder(tmp_path / "run") as folder:
        with monkeypatch.context() as disk:
            disk.setattr(whole, "create_file", lambda _: FileIO("/dev/full", "wb"))
            for name in ("a.tum", "b.tum"):
                folder.write(name, "x" * 100_000)
        folder.write("c.tum", "")
    assert folder.problem is not None
    assert "a.tum, b.tum cannot be written (No space" in folder.problem
