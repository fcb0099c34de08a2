"""`ispom perturb`: predictions from a run's folder, beside reruns of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.io.rig import read_rig
from tests.app.helpers import ran


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("perturb") / "run"
    return ran("sim:tiny", out, "--methods", "stereo", "integrated", "--no-recording")


def test_without_an_error_all_are_listed(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["perturb", str(run)]) == 0
    printed = capsys.readouterr().out
    assert "baseline +1 %" in printed and "video clock +1 ms" in printed
    assert "stereo" in printed and "integrated" in printed


def test_the_rerun_is_listed_with_the_prediction_and_near_it(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["perturb", str(run), "--baseline-percent", "2", "--clock-ms", "4", "--rerun", "--out", str(out)]
    assert main(arguments) == 0
    written = json.loads((out / "perturb.json").read_text())
    stereo = next(each for each in written["methods"] if each["method"] == "stereo")
    assert stereo["linear"] and stereo["held"]
    assert stereo["rerun_shift_m"] == pytest.approx(stereo["shift_m"], rel=0.3)
    assert {f"{m}.{kind}.tum" for m in ("stereo", "integrated") for kind in ("predicted", "rerun")} <= {
        path.name for path in out.iterdir()
    }
    assert read_rig(out / "rig.yaml").baseline_m == pytest.approx(1.02 * read_rig(run / "rig.yaml").baseline_m)


@pytest.mark.parametrize("frame", ["rig", "video"])
def test_what_does_not_depend_on_the_baseline_does_not_move(frame: str, tmp_path: Path) -> None:
    """A folder has the paths of one frame, a rerun those of each camera: they are compared at one point."""
    out, effect = tmp_path / "run", tmp_path / "effect"
    run = ["run", "sim:tiny?duration_s=2", "--methods", "monocular", "stereo", "--frame", frame, "--no-recording"]
    assert main([*run, "--out", str(out)]) == 0
    assert main(["perturb", str(out), "--baseline-percent", "2", "--rerun", "--out", str(effect)]) == 0
    found = {each["method"]: each for each in json.loads((effect / "perturb.json").read_text())["methods"]}
    monocular, stereo = found["monocular"], found["stereo"]
    assert monocular["shift_m"] == pytest.approx(0.0, abs=1e-7)
    assert monocular["rerun_shift_m"] == pytest.approx(0.0, abs=1e-7), "its images and calibration are the same"
    assert monocular["rerun_rmse_m"] == pytest.approx(monocular["rmse_m"], rel=1e-5)
    assert monocular["held"]
    assert stereo["rerun_shift_m"] > 1e-3 and stereo["held"]


def test_what_an_integration_leaves_out_makes_its_prediction_rough(run: Path, tmp_path: Path) -> None:
    rough = {}
    for name, option in (("turn", "--turn-y-deg"), ("clock", "--clock-ms")):
        assert main(["perturb", str(run), option, "0.5", "--out", str(tmp_path / name)]) == 0
        written = json.loads((tmp_path / name / "perturb.json").read_text())
        rough[name] = {each["method"]: each["rough"] for each in written["methods"]}
    assert rough == {
        "turn": {"stereo": False, "integrated": True},
        "clock": {"stereo": False, "integrated": False},
    }


def test_a_focal_length_that_the_method_corrects_makes_its_prediction_rough(tmp_path: Path) -> None:
    out = tmp_path / "run"
    ran("sim:tiny", out, "--methods", "monocular", "--no-recording")
    left_out = {}
    for option in ("--video-focal-percent", "--video-centre-x-px"):
        assert main(["perturb", str(out), option, "1", "--out", str(tmp_path / option)]) == 0
        written = json.loads((tmp_path / option / "perturb.json").read_text())
        left_out[option] = written["methods"][0]["left_out"]
    assert "focal length" in left_out["--video-focal-percent"]
    assert left_out["--video-centre-x-px"] == ""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rerun"], "--rerun needs an error of the calibration"),
        (["--baseline-percent", "70"], "baseline"),
    ],
)
def test_a_mistake_is_one_sentence(
    run: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["perturb", str(run), *options]) == 2
    assert said in capsys.readouterr().err


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["perturb", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err


def test_the_run_leaves_the_rig_as_its_methods_corrected_it(run: Path) -> None:
    text = (run / "rig_corrected.yaml").read_text()
    assert "# right camera yaw" in text and "+-" in text
    assert read_rig(run / "rig_corrected.yaml").baseline_m == pytest.approx(
        read_rig(run / "rig.yaml").baseline_m, rel=1e-3
    )
