"""Cameras without a calibration: what the files tell, what is guessed, and that both are told."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.guess import METADATA_SIGMA, USUAL_SIGMA, guess_of_film, guess_of_photo, guessed
from ispom.sequences.quicktime import quicktime_metadata

SIZE = (320, 240)
DIAGONAL = 400.0
KEY = b"com.apple.quicktime.camera.focal_length.35mm_equivalent"


def photo(path: Path, entries: dict[int, object]) -> Path:
    image = Image.fromarray(np.random.default_rng(1).integers(0, 255, SIZE[::-1], np.uint8))
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(entries)
    image.save(path, exif=exif)
    return path


def atom(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(body), name) + body


def film(path: Path, kind: int, value: bytes) -> Path:
    """The atoms of a film without any image."""
    keys = atom(b"keys", struct.pack(">II", 0, 2) + atom(b"mdta", b"com.apple.quicktime.make") + atom(b"mdta", KEY))
    items = b"".join(
        atom(struct.pack(">I", n), atom(b"data", struct.pack(">II", k, 0) + body))
        for n, k, body in ((1, 1, b"Maker"), (2, kind, value))
    )
    meta = atom(b"meta", keys + atom(b"ilst", items))
    path.write_bytes(atom(b"ftyp", b"qt  ") + atom(b"mdat", bytes(100)) + atom(b"moov", atom(b"mvhd", bytes(8)) + meta))
    return path


def test_a_photo_has_its_focal_length_on_35_mm_film(tmp_path: Path) -> None:
    guess, camera = guess_of_photo(photo(tmp_path / "a.jpg", {41989: 28}))
    assert camera.fx == camera.fy == guess.focal_px == pytest.approx(28 / 43.267 * DIAGONAL)
    assert (camera.cx, camera.cy) == (159.5, 119.5)
    assert guess.sigma == METADATA_SIGMA
    assert "EXIF: 28 mm" in guess.note


def test_a_photo_has_its_focal_length_by_the_size_of_its_pixels(tmp_path: Path) -> None:
    guess, _ = guess_of_photo(photo(tmp_path / "a.jpg", {37386: 4.0, 41486: 800.0, 41488: 3}))
    assert guess.focal_px == pytest.approx(4.0 * 800 / 10)


def test_a_photo_says_how_wide_its_pixels_are(tmp_path: Path) -> None:
    """JFIF without a unit: images of a film with wide pixels."""
    content = bytearray(photo(tmp_path / "a.jpg", {}).read_bytes())
    at = content.index(b"JFIF\0") + 7
    content[at : at + 5] = struct.pack(">BHH", 0, 4, 3)
    (tmp_path / "a.jpg").write_bytes(content)
    guess, camera = guess_of_photo(tmp_path / "a.jpg")
    assert guess.aspect == pytest.approx(4 / 3) and camera.fy / camera.fx == pytest.approx(4 / 3)


@pytest.mark.parametrize("turned", [False, True])
def test_the_size_of_pixels_is_that_of_the_photo_as_it_was_taken(turned: bool, tmp_path: Path) -> None:
    """6000 px on 23.5 mm, made smaller: EXIF keeps the resolution of what the camera saw."""
    entries = {37386: 18.0, 41486: 6000 / 2.35, 41488: 3, 40962: 6000, 40963: 4500}
    if turned:
        entries |= {40962: 4500, 40963: 6000}
    guess, _ = guess_of_photo(photo(tmp_path / "a.jpg", entries))
    assert guess.focal_px == pytest.approx(18 / 23.5 * 320) and guess.sigma == METADATA_SIGMA


@pytest.mark.parametrize(
    "entries",
    [{}, {41989: 0}, {37386: 4.0}, {41989: 60_000}, {41989: 2}, {37386: 50.0, 41486: 2050.0, 41488: 3},
     {37386: 18.0, 41486: 5080.0, 41488: 2}, {37386: 4.0, 41486: 800.0, 41488: 1},
     {37386: 18.0, 41486: 2553.0, 41488: 3, 40962: 600_000}, {37386: 4.0, 41486: 800.0, 41488: (3, 3)}],
)  # fmt: skip
def test_a_photo_without_useful_metadata_leaves_a_wide_guess(tmp_path: Path, entries: dict[int, object]) -> None:
    guess, _ = guess_of_photo(photo(tmp_path / "a.jpg", entries))
    assert guess.focal_px == 0.7 * 320
    assert guess.sigma == USUAL_SIGMA
    assert "+- 30 % (a guess: 0.7" in guess.note


@pytest.mark.parametrize(
    ("kind", "value"), [(21, struct.pack(">i", 26)), (23, struct.pack(">f", 26.0)), (1, b"26"), (22, b"\x1a")]
)
def test_a_film_has_its_focal_length(tmp_path: Path, kind: int, value: bytes) -> None:
    path = film(tmp_path / "a.mov", kind, value)
    assert quicktime_metadata(path)["com.apple.quicktime.make"] == "Maker"
    guess = guess_of_film(path, SIZE)
    assert guess.focal_px == pytest.approx(26 / 43.267 * DIAGONAL)
    assert "metadata: 26 mm" in guess.note


def test_damaged_metadata_are_none(tmp_path: Path) -> None:
    content = film(tmp_path / "a.mov", 23, struct.pack(">f", 26.0)).read_bytes()
    for count in range(0, len(content), 7):
        (tmp_path / "b.mov").write_bytes(content[:count])
        assert isinstance(quicktime_metadata(tmp_path / "b.mov"), dict)
    assert quicktime_metadata(tmp_path / "missing.mov") == {}
    assert guess_of_film(tmp_path / "missing.mov", SIZE) == guessed(SIZE, None)


def test_a_folder_and_a_film_without_a_calibration_are_opened_and_the_guess_is_reported(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for i in range(4):
        photo(tmp_path / "photos" / f"{i}.jpg", {41989: 28})
    sequence = open_sequence(str(tmp_path / "photos"))
    assert sequence.rig.camera("video").fx == pytest.approx(28 / 43.267 * DIAGONAL)
    assert any("no calibration" in note for note in sequence.notes)
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SIZE)
    for _ in range(5):
        writer.write(np.zeros((*SIZE[::-1], 3), np.uint8))
    writer.release()
    sequence = open_sequence(str(tmp_path / "a.avi"))
    assert sequence.rig.camera("video").fx == 0.7 * 320
    assert any("a guess: 0.7" in note for note in sequence.notes)


def test_a_photo_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"nothing")
    with pytest.raises(InputError, match="cannot be read"):
        guess_of_photo(tmp_path / "a.jpg")
