"""The image cache: lossless, checked, and never in the way."""

from pathlib import Path

import numpy as np

from ispom.simulation.cache import ImageCache, source_key

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


def test_old_folders_are_deleted(tmp_path: Path) -> None:
    for n in range(7):
        ImageCache.open(tmp_path, f"key{n}").write("a", IMAGE)
    left = {f.name for f in tmp_path.iterdir()}
    assert len(left) == 4
    assert "key6" in left


def test_the_key_tells_values_apart() -> None:
    assert source_key(1, "a") == source_key(1, "a")
    assert source_key(1, "a") != source_key(2, "a")
