"""`ispom undecided`: what it prints and writes, before and after a recording, and sentences for mistakes."""

from __future__ import annotations

import csv
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.undecided.text import CURES, WORDS

from ispom.evaluation.doctor.hypothesis import STEPS
from ispom.evaluation.undecided.motions import MOTIONS
from ispom.evaluation.undecided.weakest import BASELINE, SCALE
from ispom.geometry import so3_exp
from ispom.io.trajectories import tum_text
from ispom.types import Trajectory
from tests.app.written import breaks_schema

CAMERA = "width: 640\nheight: 480\nfx: 500\nfy: 500\ncx: 320\ncy: 240\n"


def planned(folder: Path, turn_deg: float) -> list[str]:
    """The arguments for a straight motion of 2 m in 2 s, on which the camera pans and tilts by so much."""
    share = np.linspace(0, 1, 9)
    turns = so3_exp(np.radians(turn_deg) * np.column_stack([0.5 * share, share, 0 * share]))
    poses = Trajectory((2e9 * share).astype(np.int64), turns, np.outer(share, [0, 0, 2.0]))
    (folder / "poses.txt").write_text(tum_text(poses))
    (folder / "camera.yaml").write_text(CAMERA)
    return [str(folder / "poses.txt"), "--camera", str(folder / "camera.yaml"), "--distance", "5"]


def answered(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main(["undecided", *arguments, "--json"]) == 0
    text = capsys.readouterr().out
    assert not breaks_schema("undecided", text)
    return json.loads(text)


def test_every_number_and_every_motion_has_words() -> None:
    assert WORDS.keys() == {SCALE, *STEPS} - {BASELINE}
    assert CURES.keys() == MOTIONS.keys()


def test_a_planned_straight_motion_is_told_to_turn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (straight,) = answered(planned(tmp_path, 0.0), capsys)["stretches"]
    assert not straight["decided"] and straight["motion"]["turned_deg"] < 0.1
    assert straight["best_cure"] in ("pan", "tilt")
    (turning,) = answered(planned(tmp_path, 30.0), capsys)["stretches"]
    assert turning["weakest_px"] < straight["weakest_px"] / 3


def test_a_recording_is_answered_in_words_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "out", tmp_path / "time.svg"
    asked = ["sim:tiny", "--max-exposures", "50", "--seconds", "2", "--step", "2", "--out", str(out)]
    drawing = ["--plot", str(plot)] if find_spec("matplotlib") else []
    assert main(["undecided", *asked, *drawing]) == 0
    assert capsys.readouterr().out.count("\n") > 1
    assert not breaks_schema("undecided", (out / "undecided.json").read_text())
    found = json.loads((out / "undecided.json").read_text())
    rows = list(csv.DictReader((out / "undecided.csv").open()))
    assert len(rows) == len(found["stretches"]) > 0
    first = found["stretches"][0]
    assert float(rows[0]["weakest_px"]) == pytest.approx(first["weakest_px"])
    assert first["sigmas"].keys() >= {SCALE, "video_focal_percent", "clock_ms"}
    assert abs(first["weakest"][0]["px"]) <= first["weakest_px"] * 1.001
    assert not drawing or plot.read_text().count("<svg") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["sim:tiny", "--distance", "3"],
        ["sim:tiny", "--max-exposures", "50", "--plot", "{folder}/poses.txt"],
        ["{folder}/poses.txt", "--distance", "0", "--camera", "{folder}/camera.yaml"],
        ["{folder}/camera.yaml", "--distance", "2", "--camera", "{folder}/camera.yaml"],
        ["{folder}/nothing"],
        ["sim:tiny", "--seconds", "0"],
        ["sim:tiny", "--max-exposures", "3"],
    ],
)
def test_a_mistake_is_one_sentence(arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planned(tmp_path, 0.0)
    assert main(["undecided", *(each.format(folder=tmp_path) for each in arguments)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
