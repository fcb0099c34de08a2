"""The image cache: lossless, checked, and never in the way."""

import errno
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from ispom.simulation.rendering.cache import ImageCache, source_key

IMAGE = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    cache = ImageCache.open(tmp_path, "key")
    assert cache.read("a") is None
    assert cache.write("a", IMAGE)
    assert np.array_equal(cache.read("a"), IMAGE)
    assert [f.name for f in cache.folder.iterdir()] == ["a.png"]


def test_any_damage_is_noticed(tmp_path: Path) -> None:
    cache = ImageCache.open(tmp_path, "key")
    cache.write("a", IMAGE)
    file = cache.folder / "a.png"
    whole = file.read_bytes()
    for damaged in (b"", whole[:10], whole[:-40], whole[:500] + b"?" + whole[501:], whole + b"more"):
        file.write_bytes(damaged)
        assert cache.read("a") is None


def test_a_place_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cache = ImageCache.open(tmp_path / "file", "key")
    assert not cache.write("a", IMAGE)
    assert cache.read("a") is None


def test_a_full_disk_is_told_once_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    cache = ImageCache.open(tmp_path, "key")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    assert not cache.write("a", IMAGE) and not cache.write("b", IMAGE)
    assert not list(cache.folder.iterdir())
    (message,) = caplog.messages
    assert "No space left on device" in message and str(cache.folder) in message


def made_of_old(parent: Path) -> list[Path]:
    """Seven caches, used a day ago and later, each after the one before."""
    folders = []
    for n in range(7):
        cache = ImageCache.open(parent, f"key{n}")
        cache.write("a", IMAGE)
        folders.append(cache.folder)
    for n, folder in enumerate(folders):
        os.utime(folder, (time.time() - 86400 + n,) * 2)
    return folders


def test_old_folders_are_deleted(tmp_path: Path) -> None:
    made_of_old(tmp_path)
    ImageCache.open(tmp_path, "key6")
    assert {f.name for f in tmp_path.iterdir()} == {"key3", "key4", "key5", "key6"}


def test_what_another_app_uses_stays(tmp_path: Path) -> None:
    """Two apps on one cache: neither deletes what the other one reads or writes."""
    folders = made_of_old(tmp_path)
    ImageCache(folders[0]).read("a")
    unfinished, left = folders[1] / "1.part", folders[1] / "2.part"
    for part in (unfinished, left):
        part.write_bytes(b"")
    os.utime(left, (1e9, 1e9))
    ImageCache.open(tmp_path, "key1")
    assert folders[0].is_dir() and unfinished.exists() and not left.exists()


def test_a_cache_that_was_emptied_meanwhile_is_filled_again(tmp_path: Path) -> None:
    cache = ImageCache.open(tmp_path, "key")
    shutil.rmtree(tmp_path)
    assert cache.write("a", IMAGE) and np.array_equal(cache.read("a"), IMAGE)


def test_the_key_tells_values_apart() -> None:
    assert source_key(1, "a") == source_key(1, "a")
    assert source_key(1, "a") != source_key(2, "a")
