"""Machine code is kept, found again only for what it was made from, and never the end of a start."""

from __future__ import annotations

import ast
import importlib
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from ispom import kept_code, kernels

ROOT = Path(__file__).parents[1]
CALLED = "from ispom.kernels import kernel\n@kernel()\ndef twice(x):\n    return 2 * x\n"
CALLING = (
    "from ispom.kernels import kernel\nfrom {called} import twice\nADDED = 1\n"
    "@kernel()\ndef more(x):\n    return twice(x) + ADDED\n"
)
Make = Callable[..., ModuleType]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(kept_code, "folder", lambda: tmp_path)
    monkeypatch.setattr(kernels, "_caches", {})
    return tmp_path


@pytest.fixture
def make(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Imports a module of these sources anew, under the name that it had before."""

    def made(calling: str = CALLING, called: str = CALLED) -> ModuleType:
        place = tmp_path_factory.mktemp("sources")
        (place / "made_called.py").write_text(called)
        (place / "made_calling.py").write_text(calling.format(called="made_called"))
        monkeypatch.syspath_prepend(place)
        for name in ("made_called", "made_calling"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        kernels._caches.clear()
        return importlib.import_module("made_calling")

    return made


def compiled_anew(module: ModuleType) -> bool:
    """Calls the kernel; whether that compiled it."""
    assert module.more(3) > 0
    return bool(module.more.stats.cache_misses)


def test_code_is_kept_from_one_start_to_the_next_wherever_the_sources_are(folder: Path, make: Make) -> None:
    assert compiled_anew(make())
    assert all(kernels.is_kept(kernel) for kernel in kernels.kernels())
    assert not compiled_anew(make())


@pytest.mark.parametrize(
    "changed",
    [{"called": CALLED.replace("2 *", "5 *")}, {"calling": CALLING.replace("ADDED = 1", "ADDED = 2")}],
    ids=["a function that it calls", "a number that it uses"],
)
def test_what_it_was_made_from_has_changed(folder: Path, make: Make, changed: dict[str, str]) -> None:
    assert make().more(3) == 7
    assert make(**changed).more(3) == (16 if "called" in changed else 8)


@pytest.mark.parametrize("damage", ["empty", "cut", "one bit", "not code"])
def test_a_damaged_file_is_deleted_and_said_to_be(
    folder: Path, make: Make, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert compiled_anew(make())
    (file,) = folder.glob("made_calling.more-*.kernel")
    whole = file.read_bytes()
    flipped = bytes([whole[500] ^ 4])
    file.write_bytes(
        {
            "empty": b"",
            "cut": whole[:-100],
            "one bit": whole[:500] + flipped + whole[501:],
            "not code": kept_code.digest(b"\x80none") + b"\x80none",
        }[damage]
    )
    with caplog.at_level(logging.WARNING):
        assert compiled_anew(make())
    (message,) = caplog.messages
    assert str(file) in message and "deleted" in message
    assert not compiled_anew(make())


def test_without_a_folder_it_is_compiled_in_memory(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_code, "folder", lambda: None)
    monkeypatch.setattr(kernels, "_caches", {})
    assert compiled_anew(make())
    assert not kernels.may_keep() and kernels.kept_share() == 0


def test_a_full_disk_is_no_error(folder: Path, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(kept_code.tempfile, "mkstemp", full)
    assert compiled_anew(make()) and not list(folder.iterdir())


def test_code_that_nothing_used_for_long_is_deleted(folder: Path, make: Make) -> None:
    make().more(3)
    kept_code.remove_unused()
    assert len(list(folder.glob("made_*"))) == 2
    for file in folder.iterdir():
        kept_code.os.utime(file, (1e9, 1e9))
    kept_code.remove_unused()
    assert not list(folder.iterdir())


def test_the_share_that_is_kept_grows(folder: Path, make: Make) -> None:
    module = make()
    assert kernels.kept_share() == 0
    sys.modules["made_called"].twice(1)
    assert 0 < kernels.kept_share() < 1
    module.more(1)
    assert kernels.kept_share() == 1


@pytest.mark.parametrize("path", sorted((ROOT / "ispom").rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_all_that_is_compiled_is_a_kernel(path: Path) -> None:
    """Numba's own cache ends in a traceback where a file is damaged or no folder is writable."""
    names = {node.module for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)}
    assert "numba" not in names or path.name == "kernels.py"
