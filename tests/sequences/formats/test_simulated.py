"""sim:NAME as a sequence: times, truth, determinism, cache."""

import os
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences.formats.simulated import open_simulated, open_words
from ispom.types import Measurement, Sequence, is_stereo, is_video


def tiny(folder: Path, seed: int = 0, **others: bool) -> Sequence:
    return open_simulated("tiny", seed, folder, duration_s=0.1, **others)


def bytes_of(exposure: Measurement) -> bytes:
    if is_video(exposure):
        return exposure.image.tobytes()
    return exposure.left.tobytes() + exposure.right.tobytes()


def test_the_city_is_as_the_paper_requires(tmp_path: Path) -> None:
    sequence = open_simulated("city", cache_dir=tmp_path)
    rig, kinds, times = sequence.rig, np.array(sequence.kinds), sequence.times_ns
    assert (rig.video.width, rig.video.height, rig.left.width, rig.left.height) == (640, 480, 1280, 960)
    assert rig.video.distortion
    assert not rig.left.distortion
    assert rig.baseline_m >= 0.3
    assert np.linalg.norm(rig.rig_from_video.translation) > 0.02
    assert np.linalg.norm(rig.rig_from_video.rotvec) > 0.02
    assert (np.diff(times) > 0).all()
    assert (kinds == "video").sum() == 601
    assert (kinds == "stereo").sum() == 60
    offsets_ns = times[kinds == "stereo"][:, None] - times[kinds == "video"][None]
    assert np.abs(offsets_ns).min() > 5_000_000
    assert np.array_equal(sequence.truth.times_ns, times)
    assert sequence.truth.frame == "rig"


def test_the_same_bytes_every_time_and_from_the_cache(tmp_path: Path) -> None:
    first, again, cached = tiny(tmp_path / "a"), tiny(tmp_path / "b"), tiny(tmp_path / "a")
    for i in (0, 1, 2):
        expected = bytes_of(first[i])
        assert bytes_of(again[i]) == expected
        assert bytes_of(cached[i]) == expected
    assert is_stereo(first[1])
    assert first[1].left.shape == (480, 640, 3)
    assert first[0].image.shape == (240, 320, 3)


def test_rendering_ahead_changes_nothing(tmp_path: Path) -> None:
    quiet, busy = tiny(tmp_path / "a"), tiny(tmp_path / "b")
    busy.prepare(0)
    for i in range(len(quiet)):
        assert bytes_of(busy[i]) == bytes_of(quiet[i])


def test_seed_and_blur_shape_the_pixels(tmp_path: Path) -> None:
    plain = bytes_of(tiny(tmp_path)[0])
    assert bytes_of(tiny(tmp_path, seed=1)[0]) != plain
    assert bytes_of(tiny(tmp_path, motion_blur=True)[0]) != plain


def test_a_damaged_cache_entry_is_rendered_again(tmp_path: Path) -> None:
    expected = bytes_of(tiny(tmp_path)[0])
    entry = next(tmp_path.glob("*/*_video.png"))
    whole = entry.read_bytes()
    entry.write_bytes(whole[: len(whole) // 2])
    assert bytes_of(tiny(tmp_path)[0]) == expected
    assert entry.read_bytes() == whole


@pytest.mark.skipif(os.name != "posix", reason="needs a device that is always full")
def test_a_folder_that_cannot_be_made_only_costs_time(tmp_path: Path) -> None:
    sequence = open_simulated("tiny", 0, Path("/dev/full/cache"), duration_s=0.1)
    assert bytes_of(sequence[0]) == bytes_of(tiny(tmp_path)[0])


@pytest.mark.parametrize(
    "asked", [{"name": "mars"}, {"name": "city", "duration_s": 21.0}, {"name": "city", "duration_s": 0.0}]
)
def test_what_does_not_exist_is_refused_in_a_sentence(asked: dict, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="sim:"):
        open_simulated(cache_dir=tmp_path, **asked)


def test_the_words_may_name_the_seed() -> None:
    def truth(words: str, seed: int = 0) -> bytes:
        found = open_words(words, seed).truth
        assert found is not None
        return found.translations.tobytes()

    assert truth("tiny?seed=1") == truth("tiny#1") == truth("tiny", 1) != truth("tiny")
    assert truth("tiny?seed=1#2") == truth("tiny#2")
