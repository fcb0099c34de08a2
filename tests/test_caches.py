"""A folder to keep things in is found, and is this user's own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ispom import caches


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "home" / "ispom")
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    return tmp_path / "home"


def test_the_users_cache_comes_first(home: Path) -> None:
    assert caches.cache_folder("things") == home / "ispom" / "things"


def test_without_a_writable_home_it_is_a_private_temporary_one(home: Path) -> None:
    home.write_text("in the way")
    folder = caches.cache_folder("things")
    assert folder is not None and folder.parent.parent == home.parent / "tmp"
    assert os.name != "posix" or folder.parent.stat().st_mode & 0o777 == 0o700
    assert caches.cache_folder("things") == folder


@pytest.mark.skipif(os.name != "posix", reason="folders for temporary files are shared on POSIX systems only")
@pytest.mark.parametrize("laid", ["open", "link"])
def test_a_temporary_folder_that_others_may_write_to_is_not_taken(home: Path, laid: str) -> None:
    """Machine code is loaded from there."""
    home.write_text("in the way")
    folder = home.parent / "tmp" / f"ispom-{os.getuid()}"
    if laid == "open":
        folder.mkdir()
        folder.chmod(0o777)
    else:
        (home.parent / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(home.parent / "elsewhere")
    assert caches.cache_folder("things") is None


def test_nowhere_to_write_is_no_error(home: Path) -> None:
    home.write_text("in the way")
    (home.parent / "tmp").rmdir()
    (home.parent / "tmp").write_text("in the way")
    assert caches.cache_folder("things") is None
