"""Machine code is kept from one start to the next, in a folder per version of the sources."""

from __future__ import annotations

import ast
import json
import logging
import subprocess
import sys
from pathlib import Path

import pytest

from ispom import compiled_code

ROOT = Path(__file__).parents[1]
FACTOR, OTHER = "numerics.cholesky.factor", "numerics.lie.logs"
USE_ONE = """
from ispom import compiled_code
from ispom.kernel_list import kernel_list
from ispom.kernels import kernels
import numpy as np
from ispom.numerics.cholesky import factor
factor(2 * np.eye(3))
print(sum(sum(k.stats.cache_misses.values()) for k in kernels()), len(compiled_code.kept(kernel_list())))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "version"
    place.mkdir()
    monkeypatch.setattr(compiled_code, "folder", lambda: place)
    return place


def compiled_files(folder: Path) -> Path:
    code = folder / "numerics_1a2b" / "cholesky.factor-13.py311.1.nbc"
    code.parent.mkdir()
    code.write_bytes(b"machine code" * 100)
    (code.parent / "cholesky.factor-13.py311.nbi").write_bytes(b"index")
    compiled_code.mark_complete([FACTOR])
    return code


def start(home: Path) -> list[int]:
    """Uses one kernel in a process of its own: how many were compiled, and how many are kept."""
    environment = {"PATH": "", "HOME": str(home), "XDG_CACHE_HOME": str(home), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", USE_ONE]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return [int(word) for word in done.stdout.split()]


def test_a_second_start_compiles_nothing(tmp_path: Path) -> None:
    compiled, kept = start(tmp_path)
    assert compiled >= 1 and kept == compiled
    assert start(tmp_path) == [0, kept]


def test_code_is_complete_once_it_is_marked_so(folder: Path) -> None:
    assert compiled_code.missing([FACTOR]) == {FACTOR}
    compiled_files(folder)
    assert not compiled_code.missing([FACTOR]) and compiled_code.kept([FACTOR, OTHER]) == {FACTOR}
    assert compiled_code.missing([FACTOR, OTHER]) == {OTHER}
    compiled_code.mark_complete([OTHER])
    assert not compiled_code.missing([FACTOR, OTHER])


@pytest.mark.parametrize("damage", ["empty", "cut", "one bit", "gone", "mark"])
def test_a_damaged_folder_is_deleted(folder: Path, damage: str, caplog: pytest.LogCaptureFixture) -> None:
    file = compiled_files(folder)
    whole = file.read_bytes()
    if damage == "gone":
        file.unlink()
    elif damage == "mark":
        (folder / compiled_code.MARK).write_text(json.dumps(["other"]))
    else:
        changed = {"empty": b"", "cut": whole[:-100], "one bit": bytes([whole[0] ^ 4]) + whole[1:]}
        file.write_bytes(changed[damage])
    with caplog.at_level(logging.WARNING):
        assert compiled_code.missing([FACTOR]) == {FACTOR}
    assert str(folder) in caplog.messages[0] and not folder.exists()
    assert compiled_code.missing([FACTOR]) == {FACTOR} and len(caplog.messages) == 1


def test_folders_that_no_start_used_for_long_are_deleted(folder: Path) -> None:
    old, recent = folder.parent / "old", folder.parent / "recent"
    old.mkdir()
    recent.mkdir()
    compiled_code.os.utime(old, (1e9, 1e9))
    compiled_files(folder)
    assert not old.exists() and recent.exists() and folder.exists()


def test_without_a_folder_each_process_compiles_what_it_uses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_code, "folder", lambda: None)
    compiled_code.mark_complete([FACTOR])
    assert not compiled_code.missing([FACTOR]) and not compiled_code.kept([FACTOR])


def test_a_changed_part_has_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    read = Path.read_bytes
    before = compiled_code._version()
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"#" * (path.name == "vectors.py"))
    assert compiled_code._version() != before


@pytest.mark.parametrize("path", sorted((ROOT / "ispom").rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_only_one_module_names_numba(path: Path) -> None:
    names = {node.module for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)}
    assert "numba" not in names or path.name == "kernels.py"
