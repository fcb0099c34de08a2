"""The image cache: lossless, checked, and never in the way."""

import errno
import os
import shutil
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ispom.simulation.rendering.cache import AheadRenderer, ImageCache, source_key
from ispom.types import Image

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


def test_a_full_disk_is_reported_once_and_leaves_nothing_half_written(
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


def test_the_key_distinguishes_values() -> None:
    assert source_key(1, "a") == source_key(1, "a")
    assert source_key(1, "a") != source_key(2, "a")


# Rendering ahead: every image is made once, in whatever order and by whatever thread it is asked for.


NAMES = [f"{i:03d}" for i in range(30)]


class Maker:
    """Makes image i of value i, counts how often, and tells when the last one is made."""

    def __init__(self) -> None:
        self.made: Counter[int] = Counter()
        self.last = threading.Event()

    def __call__(self, i: int, threads: int) -> Image:
        self.made[i] += 1
        if i == len(NAMES) - 1:
            self.last.set()
        return np.full((4, 6, 3), i, np.uint8)


def test_nothing_is_made_twice(tmp_path: Path) -> None:
    maker = Maker()
    ahead = AheadRenderer(NAMES, maker, ImageCache.open(tmp_path, "key"))
    ahead.prepare(0)
    with ThreadPoolExecutor(3) as pool:
        images = list(pool.map(ahead.get, [*range(30), *range(30), 3, 1, 2]))
    ahead.stop()
    assert [int(i[0, 0, 0]) for i in images] == [*range(30), *range(30), 3, 1, 2]
    assert set(maker.made) == set(range(30))
    assert set(maker.made.values()) == {1}


def test_the_background_makes_the_rest(tmp_path: Path) -> None:
    maker = Maker()
    ahead = AheadRenderer(NAMES, maker, ImageCache.open(tmp_path, "key"))
    ahead.prepare(10)
    assert maker.last.wait(20)
    ahead.stop()
    assert set(maker.made) == set(range(10, 30))


def test_without_a_disk_it_goes_no_further_than_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    maker = Maker()
    ahead = AheadRenderer(NAMES, maker, ImageCache.open(tmp_path / "file", "key"))
    assert ahead.get(0)[0, 0, 0] == 0
    ahead.prepare(1)
    assert ahead.get(12)[0, 0, 0] == 12
    ahead.stop()
    assert max(maker.made) < 25
    assert set(maker.made.values()) == {1}


def test_an_error_reaches_every_caller_and_the_next_try_may_succeed(tmp_path: Path) -> None:
    calls: list[int] = []

    def make(i: int, threads: int) -> Image:
        calls.append(i)
        if len(calls) == 1:
            raise MemoryError
        return np.zeros((2, 2, 3), np.uint8)

    ahead = AheadRenderer(NAMES, make, ImageCache.open(tmp_path, "key"))
    with pytest.raises(MemoryError):
        ahead.get(5)
    assert ahead.get(5).shape == (2, 2, 3)


def test_the_threads_end_with_their_owner(tmp_path: Path) -> None:
    others = set(threading.enumerate())
    ahead = AheadRenderer(NAMES, Maker(), ImageCache.open(tmp_path, "key"))
    ahead.prepare(0)
    threads = [t for t in set(threading.enumerate()) - others if t.name == "render-ahead"]
    del ahead
    assert threads
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
