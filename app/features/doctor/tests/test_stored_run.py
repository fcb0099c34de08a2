"""`ispom doctor` of a stored run: the fork is exact, and the answer names the option that helps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_events.stretch import Stretch
from ispom_app.engine.run_folder.run_file import read_run_file
from ispom_app.features.doctor.origin import Origin
from ispom_app.features.doctor.rerun import rerun

from ispom.ensemble import build
from ispom.sequences import open_sequence
from tests.app.helpers import ran

FRAMES = 50
SOURCE = "sim:tiny"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("doctor") / "run"
    options = ("--methods", "monocular", "stereo", "--monocular.max-tracks", "50", "--max-exposures", str(FRAMES))
    return ran(SOURCE, found, *options, "--no-recording", builder=build)


def test_the_rerun_of_a_stored_run_is_the_run(folder: Path) -> None:
    sequence = open_sequence(SOURCE, max_exposures=FRAMES)
    origin = Origin.of_folder(folder, read_run_file(folder), sequence)
    found = rerun(origin, Stretch(30, FRAMES - 1, 40), lambda doing: " with " not in doing)
    assert not found.note and found.last == FRAMES - 1
    assert "--monocular.max-tracks 500" in found.left


@pytest.mark.slow
def test_the_answer_has_the_option_that_helps(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "doctor"
    assert main(["doctor", str(folder), "--at", "40", "--seconds", "600", "--out", str(out)], build) == 0
    found = json.loads((out / "doctor.json").read_text())
    assert found["causes"][0] == "monocular.max-tracks" and not found["left"] and not found["reruns"]["left"]
    (helping,) = [row for row in found["reruns"]["tried"] if row["option"] == "--monocular.max-tracks 500"]
    (unchanged,) = [row for row in found["reruns"]["unchanged"] if row["method"] == "monocular"]
    assert helping["helps"] and helping["located"] > unchanged["located"]
