"""Rendering ahead: every image is made once, in whatever order and by whatever thread it is asked for."""

import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ispom.simulation.rendering.cache import AheadRenderer, ImageCache
from ispom.types import Image

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


def test_an_error_reaches_whoever_asked_and_the_next_try_may_succeed(tmp_path: Path) -> None:
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
