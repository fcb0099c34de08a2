"""Target specs, and their pages: true size, and what they show is what is detected."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from ispom.calibration.detection.detect import detect
from ispom.calibration.targets.drawing import MARGIN_M, page_size_m, pdf, raster, svg
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError

SPECS = {
    "chessboard:9x6:0.0242": 54,
    "charuco:8x5:0.03:0.022": 28,
    "charuco:8x5:0.03:0.022:5X5_100": 28,
    "aprilgrid:6x6:0.088:0.3": 144,
    "apriltag:4x3:0.05:0.01": 48,
    "aruco:5x7:0.04:0.01:DICT_6X6_250": 140,
    "circles:7x5:0.03": 35,
    "acircles:4x11:0.02:0.006": 44,
}


@pytest.mark.parametrize("spec", SPECS)
def test_a_page_has_the_points_where_the_target_says(spec: str) -> None:
    target = parse_target(spec)
    assert len(target) == SPECS[spec]
    pixels_per_m = 900 / max(target.size_m)
    found = detect(target, raster(target, pixels_per_m))
    expected = (target.xyz_in_board[found.ids, :2] + MARGIN_M) * pixels_per_m - 0.5
    assert len(found) == len(target)
    assert np.abs(found.uv - expected).max() < 0.3


@pytest.mark.parametrize("spec", SPECS)
def test_pages_are_of_true_size(spec: str) -> None:
    target = parse_target(spec)
    width, height = page_size_m(target)
    root = ElementTree.fromstring(svg(target))
    assert float(root.attrib["width"].removesuffix("mm")) == pytest.approx(1000 * width)
    box = re.search(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", pdf(target))
    assert box is not None
    assert [float(side) / 72 * 0.0254 for side in box.groups()] == pytest.approx([width, height], abs=1e-6)
    shapes = [shape for shape in root.iter() if shape.tag.endswith("rect") and "x" in shape.attrib]
    if shapes:
        right = max(float(shape.attrib["x"]) + float(shape.attrib["width"]) for shape in shapes)
        assert right == pytest.approx(1000 * (target.size_m[0] + MARGIN_M), abs=1000 * target.pitch_m)


def test_the_table_of_a_pdf_says_where_its_objects_are() -> None:
    content = pdf(parse_target("acircles:4x11:0.02"))
    start = int(content.rsplit(b"startxref\n", 1)[1].split()[0])
    assert content[start:].startswith(b"xref")
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", content), 1):
        assert content[int(place) :].startswith(b"%d 0 obj" % number)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("checker:9x6:0.02", "there is no target called 'checker'"),
        ("chessboard", "columns and rows are missing"),
        ("chessboard:9:0.02", "columns and rows are missing"),
        ("chessboard:2x6:0.02", "not from 3 to 60"),
        ("chessboard:9x6", "sizes are not as expected"),
        ("chessboard:9x6:0", "'0' is not a size"),
        ("chessboard:9x6:nan", "'nan' is not a size"),
        ("chessboard:9x6:24.2", "'24.2' is not a size up to 10 m"),
        ("charuco:8x5:0.03:0.04", "do not fit"),
        ("charuco:8x5:0.03:0.02:7X7_9", "no dictionary 7X7_9"),
        ("aruco:9x9:0.03:0.02", "has 50 markers, the board needs 81"),
        ("circles:7x5:0.03:0.02", "touch each other"),
    ],
)
def test_a_wrong_spec_is_refused_in_one_sentence(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        parse_target(spec)
