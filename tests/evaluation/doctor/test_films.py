"""A film whose images do not fit its calibration any more is named with its figure, and a right one is not."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.suspects.zoom import growth_of, zoom_jumps
from tests.film_variants import JUMP, film

RIGHT = {
    "squeezed in height": ("aspect", "aspect_percent", -25.0),
    "squeezed in width": ("aspect", "aspect_percent", 100 / 0.75 - 100),
    "focal length too long": ("video-focal", "video_focal_percent", 100 / 1.22 - 100),
    "distortion zeroed": ("distortion", "k1", -0.22),
}
"""The first cause, and the figure that is right."""
SIGMAS = 2.0


QUICK = "squeezed in height"


@pytest.mark.parametrize("name", [n if n == QUICK else pytest.param(n, marks=pytest.mark.slow) for n in RIGHT])
def test_what_does_not_fit_the_calibration_is_the_first_cause(name: str) -> None:
    key, figure, right = RIGHT[name]
    found = diagnose(examination(film(name), 0, 44)).causes[0]
    assert found.suspect.key == key
    values = found.finding.values
    assert abs(values[figure] - right) < SIGMAS * values[f"{figure}_sigma"]


@pytest.mark.slow
def test_images_that_were_undistorted_twice_have_another_distortion_than_stated() -> None:
    found = diagnose(examination(film("undistorted twice"), 0, 44)).causes[0]
    assert found.suspect.key == "distortion" and found.finding.values["k1"] > 0.1


@pytest.mark.parametrize("name", ["as it was", pytest.param("mirrored", marks=pytest.mark.slow)])
def test_a_right_film_has_no_cause_and_a_mirrored_one_looks_right(name: str) -> None:
    assert not diagnose(examination(film(name), 0, 44)).causes


def test_a_zoom_that_jumps_is_found_at_its_frame() -> None:
    found = zoom_jumps(examination(film("zoom"), 0, 44))
    assert found is not None and found.found and found.frames == (JUMP,)
    assert found.values["growth_percent"] == pytest.approx(15, abs=0.5)


def test_going_ahead_is_no_zoom() -> None:
    """Before a wall that a camera approaches, everything grows by the same share."""
    wall = np.random.default_rng(3).uniform(-100, 100, (60, 2))
    before, after = wall + 160, 1.02 * wall + 160
    growth = growth_of(before, after, 30)
    assert growth == pytest.approx((np.log(1.02), 0), abs=1e-9)
    assert growth_of(before[:20], after[:20], 30) is None
    found = zoom_jumps(examination(film("as it was"), 0, 44))
    assert found is not None and not found.found
