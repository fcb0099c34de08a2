"""What films say about themselves: which images they show, when, and how wide their pixels are."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.calibration.tracked.self_calibration import self_calibrated
from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Sequence, is_video
from tests.sequences.films import scales, turned, with_aspect, with_edits
from tests.sequences.folders import images
from tests.sequences.own_folders import CAMERA, in_bgr, write_uneven_video, write_video

STEP_NS = 50_000_000
UNEVEN = [*range(10), *range(13, 23), *range(24, 44, 2)]
REPORTS = Path(__file__).parents[4] / "shared" / "data" / "reports"


def film(path: Path, ticks: list[int] | None = None) -> Path:
    """Thirty images, at 20 Hz or at ticks of it, with a calibration."""
    path.parent.mkdir(exist_ok=True)
    path.with_suffix(".yaml").write_text(CAMERA.replace("rate_hz: 20\n", ""))
    stream = images(30, 0)
    return write_video(path, stream, 20, "mp4v") if ticks is None else write_uneven_video(path, stream, ticks)


def seen(sequence: Sequence, i: int) -> np.ndarray:
    exposure = sequence[i]
    assert is_video(exposure)
    return exposure.image


@pytest.mark.parametrize("name", ["film.mp4", "film.mov"])
@pytest.mark.parametrize("first", [2, 3, 10, 14])
def test_of_a_trimmed_film_what_is_shown_has_its_own_time(first: int, name: str, tmp_path: Path) -> None:
    """Packets before an edit list have times, and their images are not shown."""
    ticks = None if name == "film.mp4" else UNEVEN
    path = film(tmp_path / name, ticks)
    whole = open_sequence(str(shutil.copytree(tmp_path, tmp_path / "whole") / name))
    movie, media = scales(path)
    ticks = ticks or list(range(30))
    with_edits(path, [(10 * movie, ticks[first] * media // 20)])
    sequence = open_sequence(str(path))
    assert len(sequence) == 30 - first
    assert sequence.times_ns.tolist() == [(tick - ticks[first]) * STEP_NS for tick in ticks[first:]]
    assert any(f"{30 - first} of 30 images" in note for note in sequence.notes)
    for i in (0, 29 - first, 3, 12, 5):
        np.testing.assert_array_equal(seen(sequence, i), seen(whole, i + first))


@pytest.mark.parametrize("ticks", [None, UNEVEN])
def test_a_film_that_begins_with_nothing_begins_with_its_first_image(ticks: list[int] | None, tmp_path: Path) -> None:
    path = film(tmp_path / "film.mov" if ticks else tmp_path / "film.mp4", ticks)
    movie, _ = scales(path)
    before = open_sequence(str(path)).times_ns.tolist()
    with_edits(path, [(movie, -1), (3 * movie, 0)])
    sequence = open_sequence(str(path))
    assert sequence.times_ns.tolist() == before and not any("of 30 images" in note for note in sequence.notes)


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_pixels_are_as_wide_as_the_film_says(degrees: int, tmp_path: Path) -> None:
    path = with_aspect(film(tmp_path / "film.mp4"), 4, 3)
    path.with_suffix(".yaml").unlink()
    if degrees:
        turned(path, degrees)
    sequence = open_sequence(str(path))
    camera, upright = sequence.rig.camera("video"), degrees % 180 == 0
    aspect = 4 / 3 if upright else 3 / 4
    assert (camera.width, camera.height) == ((96, 64) if upright else (64, 96))
    assert camera.fy / camera.fx == pytest.approx(aspect)
    assert camera.fy == pytest.approx(0.7 * (128 if upright else 96))
    assert sequence.guess is not None and any("times as wide as high" in note for note in sequence.notes)
    assert seen(sequence, 0).shape[:2] == (camera.height, camera.width)


def test_a_calibration_with_other_pixels_than_the_film_is_noted(tmp_path: Path) -> None:
    path = film(tmp_path / "film.mp4")
    assert not any("times as wide" in note for note in open_sequence(str(path)).notes)
    with_aspect(path, 4, 3)
    assert any("1.333 times as wide as high, the calibration" in note for note in open_sequence(str(path)).notes)
    path.with_suffix(".yaml").write_text(CAMERA.replace("fx: 80", "fx: 60"))
    assert not any("times as wide" in note for note in open_sequence(str(path)).notes)


def test_the_camera_of_a_film_with_wide_pixels_is_found_in_its_images() -> None:
    path = REPORTS / "14_anamorphic_film" / "anamorphic91.mp4"
    if not path.exists():
        pytest.skip("../shared/data/reports is absent")
    camera = self_calibrated(open_sequence(str(path)), most_images=91, most_views=20).rig.camera("video")
    assert camera.fx == pytest.approx(226 * 0.75, rel=0.02) and camera.fy == pytest.approx(227.5, rel=0.02)


@pytest.mark.parametrize("name", ["12:30:05.mp4", "http:film.mp4", "concat:a|b.mp4", "%03d.mp4", "100 %.mp4"])
def test_a_film_may_have_any_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    film(tmp_path / "film.mp4").rename(tmp_path / name)
    (tmp_path / "camera.yaml").write_text(CAMERA)
    monkeypatch.chdir(tmp_path)
    assert len(open_sequence(name)) == len(open_sequence(f"./{name}")) == 30


def test_a_film_s_own_rate_does_not_count_where_its_images_have_another(tmp_path: Path) -> None:
    """Headers of MKV may have a rate of 1000 Hz."""
    path = film(tmp_path / "film.mkv", [3 * i for i in range(30)])
    sequence = open_sequence(str(path))
    assert sequence.times_ns.tolist() == [3 * i * STEP_NS for i in range(30)]


@pytest.mark.parametrize(
    ("name", "codec"), [("a.webm", "VP80"), ("a.webm", "VP90"), ("a.mkv", "VP90"), ("a.avi", "XVID")]
)
def test_packets_that_show_nothing_are_no_images(name: str, codec: str, tmp_path: Path) -> None:
    """Codecs of the web have such ones; others are late by an image."""
    path = tmp_path / name
    path.with_suffix(".yaml").write_text(CAMERA.replace("rate_hz: 20\n", ""))
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), 20, (96, 64))
    if not writer.isOpened():
        pytest.skip(f"this OpenCV does not write {codec}")
    stream = images(40, 0)
    for image in stream:
        writer.write(in_bgr(image))
    writer.release()
    sequence = open_sequence(str(path))
    assert len(sequence) == 40
    np.testing.assert_allclose(np.diff(sequence.times_ns), STEP_NS, atol=1_000_000)
    for i in (39, 0, 17, 5):
        found = seen(sequence, i).astype(int).mean(2)
        assert min(range(40), key=lambda k: np.abs(found - stream[k]).mean()) == i


def test_a_film_of_nothing_is_refused(tmp_path: Path) -> None:
    path = film(tmp_path / "film.mp4")
    movie, media = scales(path)
    with_edits(path, [(movie, 100 * media)])
    try:
        assert len(open_sequence(str(path))) >= 3
    except InputError as error:
        assert "film.mp4" in str(error)
