"""What expressions are worth at an exposure, and that what is missing makes them false."""

from __future__ import annotations

import pytest
from ispom_app.engine.conditions.evaluate import holds, values
from ispom_app.engine.conditions.parser import parse
from ispom_app.engine.history.quantities import NO_ROW, Row, quantities

KNOWN = quantities(["monocular", "stereo"])
BEFORE: Row = {"": {"exposure": 6}, "stereo": {"status": "tracking", "inliers": 40, "scale": 1.0, "key_frame": False}}
NOW: Row = {
    "": {"exposure": 7, "time_s": 0.5},
    "stereo": {"status": "lost", "inliers": 20, "scale": 1.5, "key_frame": True, "error_m": None},
}


def worth(text: str, now: Row = NOW, before: Row = BEFORE) -> bool:
    return holds(parse(text, KNOWN), now, before)


@pytest.mark.parametrize(
    "text",
    [
        "stereo.inliers == 20 and stereo.inliers <= 20 and stereo.inliers >= 20 and stereo.inliers != 21",
        "stereo.inliers * 2 + 2 - 1 == 41 and stereo.inliers / 8 == 2.5 and 30 - stereo.inliers - 5 == 5",
        "-stereo.inliers == -20 and abs(10 - stereo.inliers) == 10 and 2 + 3 * stereo.scale == 6.5",
        "stereo.status == 'lost' and stereo.status != \"tracking\"",
        "stereo.key_frame and not stereo.inliers > 20",
        "stereo.inliers > 99 or exposure == 7",
        "stereo.key_frame or stereo.inliers > 99 and stereo.inliers > 99",
        "((stereo.inliers)<(30))and\n\tstereo.inliers > 1",
        "10 < stereo.inliers < 30 and not 10 < stereo.inliers < 20",
        "40 - stereo.inliers - 10 - 2 * 3 == 4",
        "changed(stereo.status) and changed(stereo.inliers) and changed(stereo.key_frame)",
        "increased(stereo.scale) and not increased(stereo.inliers) and increased(-stereo.inliers)",
        "changed(stereo.inliers < 30) and not changed(stereo.inliers < 50)",
    ],
)
def test_true(text: str) -> None:
    assert worth(text) and not worth(f"not ({text})")


@pytest.mark.parametrize(
    "text",
    [
        "stereo.error_m < 1",
        "stereo.error_m >= 1",
        "stereo.error_m != 1",
        "stereo.error_m + 1 > 0",
        "abs(stereo.error_m) >= 0",
        "-stereo.error_m < 1",
        "stereo.displacement < 1",
        "monocular.inliers < 30",
        "monocular.key_frame",
        "changed(stereo.error_m)",
        "increased(monocular.inliers)",
        "stereo.inliers / 0 > 1",
        "stereo.inliers / (stereo.inliers - 20) > 1",
        "1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15"
        " * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * 1e15 * stereo.inliers > 1",
    ],
)
def test_what_is_missing_makes_it_false(text: str) -> None:
    assert not worth(text) and worth(f"not ({text})")


@pytest.mark.parametrize("text", ["changed(stereo.status)", "increased(stereo.scale)"])
def test_at_the_first_exposure_nothing_has_changed(text: str) -> None:
    assert not worth(text, before=NO_ROW)


def test_the_values_that_are_reported() -> None:
    found = values(parse("stereo.inliers < 30 and monocular.key_frame and exposure > 3", KNOWN), NOW)
    assert found == {"stereo.inliers": 20, "monocular.key_frame": None, "exposure": 7}
