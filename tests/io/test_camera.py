"""Calibrations that no camera has are refused by name, before memory is taken for their images."""

from __future__ import annotations

from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.io.camera import camera_of

GOOD = {"width": 752, "height": 480, "fx": 458.6, "fy": 457.3, "cx": 367.2, "cy": 248.4}
EUROC = [-0.283, 0.0739, 0.0002, 0.00002]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 30_000, "height": 30_000}, "image size 30000 x 30000 is not within"),
        ({"width": 100_000, "height": 1}, "image size 100000 x 1 is not within"),
        ({"width": 1e300}, "width.*too large"),
        ({"width": 752.5}, "width is 752.5, not a size in whole pixels"),
        ({"height": 0}, "height is 0, not positive"),
        ({"fx": -1}, "fx is -1, not positive"),
        ({"fx": float("nan")}, "fx needs 1 finite number"),
        ({"fy": 1e-9}, "fy is 1e-09 px, not within 0.01 to 1000 times"),
        ({"fx": 1e12}, r"fx is 1e\+12 px, not within"),
        ({"cy": 1e12}, r"cy is 1e\+12 px, far outside of the image"),
        ({"cx": -1e5}, r"cx is -100000 px, far outside of the image"),
        ({"distortion": [-0.28, 0.07, 1, 0]}, "the distortion cannot be undone"),
        ({"distortion": [1e9, 0, 0, 0]}, "the distortion cannot be undone"),
        ({"line_delay_s": 0.003}, "line_delay_s is 0.003, but from the first row to the last are at most 1 s"),
        ({"distortion": [float("inf"), 0, 0, 0]}, "distortion needs 0 or 4 or 5 or 8 finite"),
    ],
)
def test_an_impossible_value_is_named(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=f"c.yaml: left.*{message}"):
        camera_of(Path("c.yaml"), GOOD | changes, "left.")


@pytest.mark.parametrize(
    "changes",
    [
        {"distortion": EUROC},
        {"distortion": [0.2624, -0.9531, -0.0054, 0.0026, 1.1633]},
        {"width": 1920, "height": 1080, "fx": 870, "fy": 870, "distortion": [-0.26, 0.08, 0, 0, -0.011]},
        {"cx": -300},
        {"width": 8192, "height": 8192},
    ],
    ids=["EuRoC", "TUM fr1", "turns back in the corners", "cropped", "largest"],
)
def test_real_calibrations_are_taken(changes: dict) -> None:
    assert camera_of(Path("c.yaml"), GOOD | changes).fx > 0
