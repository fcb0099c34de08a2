"""Moving objects, in a street with traffic and where only the lens is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.suspects.moving import moving
from ispom.sequences import open_sequence
from ispom.simulation.scenario.kinds import kind_of_words, with_fault

DATA = Path(__file__).parents[4] / "shared/data"


def test_traffic_is_found() -> None:
    finding = moving(examination(open_sequence("sim:tiny?vehicles=40&people=200", seed=2), 0, 49))
    assert finding is not None and finding.found


@pytest.mark.skipif(not (DATA / "handheld_board").exists(), reason="no ../shared/data/handheld_board")
@pytest.mark.parametrize("first", [150, 205])
def test_tracks_at_the_border_of_a_lens_that_is_off_there_do_not_move(first: int) -> None:
    finding = moving(examination(open_sequence(str(DATA / "handheld_board")), first, first + 44))
    assert finding is None or not finding.found


@pytest.mark.parametrize("seed", [730, 731])
def test_an_object_before_the_scene_is_found(seed: int) -> None:
    kind = kind_of_words("object")
    finding = moving(examination(with_fault(open_sequence("sim:tiny", seed=seed), kind, seed), 0, 49))
    assert finding is not None and finding.found


@pytest.mark.skipif(not (DATA / "hard/box_handheld").exists(), reason="no ../shared/data/hard/box_handheld")
def test_a_large_object_before_a_camera_at_rest_is_found() -> None:
    finding = moving(examination(open_sequence(str(DATA / "hard/box_handheld")), 230, 274))
    assert finding is not None and finding.found
