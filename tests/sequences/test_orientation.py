"""Photos of one camera that EXIF would turn differently: all are turned alike, and that is said."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main
from PIL import Image as Writer

from ispom.sequences import open_sequence
from ispom.sequences.images import read_image
from ispom.sequences.orientation import common_orientation
from ispom.types import is_video
from tests.sequences.folders import HEIGHT, WIDTH, images, make_tum

REPORTS = Path(__file__).parents[2].parent / "shared" / "data" / "reports"
CAMERA = "{width: %d, height: %d, fx: 80, fy: 80, cx: 47.5, cy: 31.5, rate_hz: 20}\n"


def photo(path: Path, pixels: np.ndarray, orientation: int | None, form: str = "JPEG") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    exif = Writer.Exif()
    if orientation is not None:
        exif[0x0112] = orientation
    Writer.fromarray(pixels).save(path, form, exif=exif, **({"quality": 95} if form == "JPEG" else {}))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
def test_an_orientation_that_is_common_is_that_of_opencv(orientation: int, suffix: str, tmp_path: Path) -> None:
    form = {"jpg": "JPEG", "png": "PNG", "webp": "WEBP"}[suffix]
    paths = [tmp_path / f"{i}.{suffix}" for i in range(3)]
    for path, pixels in zip(paths, images(3, 8), strict=True):
        photo(path, pixels, orientation, form)
    found, note = common_orientation(paths)
    assert found == orientation and not note
    for path in paths:
        np.testing.assert_array_equal(read_image(path, None, found), read_image(path))


@pytest.mark.parametrize(("first", "other"), [(1, 3), (3, 1), (None, 3), (1, 6), (None, 8)])
def test_images_of_a_folder_are_all_turned_the_same_way(first: int | None, other: int, tmp_path: Path) -> None:
    """The phone looked down and changed its mind, for two of six."""
    for i, pixels in enumerate(images(6, 8)):
        photo(tmp_path / f"{i:03d}.jpg", pixels, other if i in (2, 4) else first)
    turned = (first or 1) == 3
    (tmp_path / "camera.yaml").write_text(CAMERA % (WIDTH, HEIGHT))
    sequence = open_sequence(str(tmp_path))
    assert any("turned differently" in note for note in sequence.notes)
    for i in range(6):
        exposure = sequence[i]
        assert is_video(exposure)
        raw = cv2.imread(str(tmp_path / f"{i:03d}.jpg"), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        assert raw is not None
        np.testing.assert_array_equal(exposure.image, raw[::-1, ::-1] if turned else raw)


def test_without_a_calibration_too(tmp_path: Path) -> None:
    """The first one stands upright, all others lie: the camera's images lie."""
    for i, pixels in enumerate(images(6, 8)):
        photo(tmp_path / f"{i:03d}.jpg", pixels, 6 if i == 0 else 1)
    sequence = open_sequence(str(tmp_path))
    exposure = sequence[0]
    assert is_video(exposure) and exposure.image.shape == (HEIGHT, WIDTH)


def test_images_of_a_list_too(tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    for i, path in enumerate(sorted(folder.glob("rgb/*.jpg"))):
        photo(path, np.asarray(Writer.open(path)), 3 if i == 3 else 1)
    assert any("turned differently" in note for note in open_sequence(str(folder)).notes)


@pytest.mark.skipif(not REPORTS.is_dir(), reason="../shared/data/reports is not there")
def test_the_photos_of_a_board_that_were_reported(capsys: pytest.CaptureFixture[str]) -> None:
    photos = REPORTS / "09_exif_orientation_flips" / "chess_exif3_half"
    assert main(["calibrate", "video", str(photos), "--target", "chessboard:9x6:0.03", "--model", "pinhole"]) == 0
    printed = capsys.readouterr()
    assert "turned differently: 8 " in printed.err and "two halves" not in printed.out
    assert "fx 520.0" in printed.out and "cx 344.7" in printed.out
