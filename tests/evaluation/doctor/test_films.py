"""A film whose images do not fit its calibration any more is named with its figure, and a right one is not."""

from __future__ import annotations

import pytest

from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.examination import examination
from tests.film_variants import film

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
