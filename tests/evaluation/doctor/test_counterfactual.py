"""The doctor finds a wrong focal length by its size, and nothing in a healthy recording; twice the same."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.examination import examination
from ispom.sequences import open_sequence


def diagnosis(words: str) -> Diagnosis:
    return diagnose(examination(open_sequence(words), 0, 48))


def test_a_healthy_recording_has_no_cause() -> None:
    assert not diagnosis("sim:tiny").causes


@pytest.mark.slow
def test_a_focal_length_is_found_by_its_size_twice_the_same() -> None:
    found = diagnosis("sim:tiny?fault=wrong-lens:focal_percent=4")
    assert found.causes[0].suspect.key == "video-focal"
    assert found.causes[0].finding.values["video_focal_percent"] == pytest.approx(100 / 1.04 - 100, abs=0.3)
    again = diagnosis("sim:tiny?fault=wrong-lens:focal_percent=4")
    assert [asdict(each.finding) for each in again.ranked] == [asdict(each.finding) for each in found.ranked]


@pytest.mark.slow
def test_a_clock_is_found_by_its_delay() -> None:
    """The fit had stopped at 14 ms: the delayed video's frames were between poses, where the motion is not even."""
    found = diagnosis("sim:tiny?fault=clock:late_s=0.02").causes[0]
    assert found.suspect.key == "clock"
    values = found.finding.values
    assert abs(values["clock_ms"] - 20) < 2 * values["clock_ms_sigma"] < 5


def test_without_time_left_nothing_is_examined() -> None:
    seen = examination(open_sequence("sim:tiny"), 0, 8)
    found = diagnose(seen, advance=lambda name: False)
    assert not found.ranked and found.left
