"""Image files: what a header claims is not decoded unless it is expected, and decoders stay silent."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError, UnreadableImage
from ispom.sequences.image_header import header_size
from ispom.sequences.images import IMAGE_SUFFIXES, decode, read_image

PNG = cv2.imencode(".png", np.random.default_rng(1).integers(0, 255, (64, 96), np.uint8))[1].tobytes()


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def claiming(width: int, height: int) -> bytes:
    """A small PNG whose header is right in all but the size."""
    return PNG[:8] + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) + PNG[33:]


@pytest.mark.parametrize("side", [9_000, 30_000, 60_000])
def test_a_decompression_bomb_is_not_decoded(side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(InputError, match=r"is 9000 x 9000, more than 67108864 px|claims more pixels"):
        decode(claiming(side, side), "bomb.png")
    with pytest.raises(InputError, match=rf"{side} x {side}, not 96 x 64 as its camera|claims more pixels"):
        decode(claiming(side, side), "bomb.png", (96, 64))


@pytest.mark.parametrize("suffix", sorted(IMAGE_SUFFIXES))
def test_the_header_of_every_kind_is_understood(suffix: str) -> None:
    content = cv2.imencode(suffix, np.zeros((64, 96) if suffix == ".pgm" else (64, 96, 3), np.uint8))[1].tobytes()
    assert header_size(content, "a") == (96, 64)
    assert decode(content, "a", (96, 64)).shape[:2] == (64, 96)


def test_an_image_turned_by_its_camera_s_note_is_read_upright() -> None:
    jpeg = cv2.imencode(".jpg", np.zeros((96, 64), np.uint8))[1].tobytes()
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    turned = jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:]
    assert header_size(turned, "a") == (64, 96)
    assert decode(turned, "a", (96, 64)).shape == (64, 96)


def jpeg_of(image: np.ndarray, progressive: bool = False, restart: int = 0) -> bytes:
    flags = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive), cv2.IMWRITE_JPEG_RST_INTERVAL, restart]
    return cv2.imencode(".jpg", image, flags)[1].tobytes()


def with_preview(jpeg: bytes) -> bytes:
    """With a smaller JPEG in its metadata, whose end is not that of the image."""
    preview = b"Exif\0\0" + jpeg_of(np.zeros((16, 16), np.uint8))
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(preview) + 2) + preview + jpeg[2:]


NOISE = np.random.default_rng(2).integers(0, 255, (64, 96, 3), np.uint8)
JPEGS = {
    "baseline": jpeg_of(NOISE),
    "progressive": jpeg_of(NOISE, progressive=True),
    "restarts": jpeg_of(NOISE, restart=4),
    "preview": with_preview(jpeg_of(NOISE)),
    "filled": jpeg_of(NOISE).replace(b"\xff\xda", b"\xff\xff\xff\xda", 1),
}
FILM = struct.pack(">I4s", 24, b"ftyp") + b"mp42" + bytes(12) + np.random.default_rng(3).bytes(20_000)


@pytest.mark.parametrize("behind", [FILM, bytes(50_000), b"\xff\xd9" * 3 + bytes(9000), jpeg_of(NOISE[:9]) + FILM])
@pytest.mark.parametrize("name", JPEGS)
def test_what_is_behind_the_end_of_a_jpeg_does_not_count(name: str, behind: bytes) -> None:
    """The film of a motion photo, a second image, zeros."""
    np.testing.assert_array_equal(decode(JPEGS[name] + behind, "a", (96, 64)), decode(JPEGS[name], "a", (96, 64)))


@pytest.mark.parametrize("name", JPEGS)
def test_a_cut_jpeg_is_not_whole_whatever_follows(name: str) -> None:
    jpeg = JPEGS[name]
    for share in (0.4, 0.6, 0.9):
        with pytest.raises(UnreadableImage, match="truncated or damaged"):
            decode(jpeg[: int(share * len(jpeg))] + bytes(9000), "a")


@pytest.mark.parametrize("behind", [FILM, b"\n", b"\0\1\0", PNG])
def test_what_is_behind_the_end_of_a_png_does_not_count(behind: bytes) -> None:
    np.testing.assert_array_equal(decode(PNG + behind, "a", (96, 64)), decode(PNG, "a", (96, 64)))
    with pytest.raises(UnreadableImage, match="truncated or damaged"):
        decode(PNG[: len(PNG) // 2] + behind, "a")


def test_decoders_write_nothing_to_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    profile = PNG[:33] + chunk(b"iCCP", b"x\0\0" + zlib.compress(b"abc" * 50)) + PNG[33:]
    jpeg = bytearray(cv2.imencode(".jpg", np.tile(np.arange(96, dtype=np.uint8), (64, 1)))[1].tobytes())
    jpeg[-40:-20] = b"\xff\xd0" * 10
    assert decode(profile, "a.png").shape == decode(bytes(jpeg), "a.jpg").shape == (64, 96)
    spoilt = PNG[:200] + bytes(20) + PNG[220:]
    tiff = bytearray(cv2.imencode(".tiff", np.zeros((64, 96), np.uint8))[1].tobytes())
    tiff[-60:] = b"\x07" * 60
    for content in (spoilt, bytes(tiff), b"", b"x"):
        with pytest.raises(UnreadableImage, match=r"^a is not"):
            decode(content, "a")
    assert capfd.readouterr().err == ""


RAMP = np.linspace(0, 1, 64 * 96).reshape(64, 96)


def written(folder: Path, name: str, images: list[np.ndarray]) -> list[Path]:
    paths = [folder / f"{i}{name}" for i in range(len(images))]
    for path, image in zip(paths, images, strict=True):
        assert cv2.imwrite(str(path), image)
    return paths


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_the_range_of_a_recording_is_that_of_all_its_images(bits: int, tmp_path: Path) -> None:
    white = 2**bits - 1
    dark, bright = (np.rint(share * white * RAMP).astype(np.uint16) for share in (0.2, 1.0))
    first, second = (read_image(path) for path in written(tmp_path, ".png", [dark, bright]))
    np.testing.assert_allclose(second, 255 * RAMP, atol=1)
    np.testing.assert_allclose(first, 0.2 * 255 * RAMP, atol=1)
    assert first.dtype == np.uint8


@pytest.mark.parametrize("white", [1.0, 255.0, 4095.0])
def test_images_of_floats_are_read(white: float, tmp_path: Path) -> None:
    dark, bright = ((share * white * RAMP).astype(np.float32) for share in (0.2, 1.0))
    dark[3, 4] = np.nan
    first, second = (read_image(path) for path in written(tmp_path, ".tiff", [dark, bright]))
    np.testing.assert_allclose(second, 255 * RAMP, atol=1)
    assert first[3, 4] == 0 and abs(int(first[-1, -1]) - 51) <= 1


@pytest.mark.parametrize("kind", [np.uint16, np.int16, np.int32, np.float32, np.float64])
def test_tiffs_in_colour_are_read_whatever_their_values(kind: type, tmp_path: Path) -> None:
    colours = (200 * np.dstack([RAMP, RAMP[::-1], 0.5 * RAMP])).astype(kind)
    (path,) = written(tmp_path, ".tiff", [colours])
    np.testing.assert_array_equal(read_image(path, (96, 64)), np.rint(colours[..., ::-1]).astype(np.uint8))


@pytest.mark.parametrize(
    ("low", "high", "kind"), [(29000, 31000, np.uint16), (7400, 8400, np.uint16), (285, 310, float)]
)
def test_thermal_images_use_the_range_that_they_have(low: float, high: float, kind: type, tmp_path: Path) -> None:
    hot = (low + (high - low) * RAMP).astype(np.float32 if kind is float else kind)
    cold = (low + (high - low) * RAMP / 2).astype(hot.dtype)
    hot[0, 0], cold[5, 5] = 0, 60000
    first, second = (read_image(path) for path in written(tmp_path, ".tiff", [cold, hot]))
    assert np.ptp(second[1:]) >= 110 and 50 <= np.ptp(first[6:]) <= 70
    assert (second[0, 0], first[5, 5]) == (0, 255)
