"""What a calibration says that the file of another program cannot hold is said where it is written."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.io.rig import read_rig, rig_text
from ispom.simulation.cameras import Optics, simulated_rig


@pytest.mark.parametrize(
    ("form", "out"), [("kalibr", "c.yaml"), ("euroc", "c"), ("opencv", "c.yml"), ("ros", "c"), ("colmap", "c.txt")]
)
def test_a_line_delay_that_is_left_out_is_reported(
    form: str, out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, optics in (("rolling", Optics(rolling_ns=20_000_000)), ("still", Optics())):
        rig = simulated_rig(1.0, optics).changed(video=None, video_sigma=None, pair_sigma=None)
        (tmp_path / f"{name}.yaml").write_text(rig_text(rig))
    convert = ["calibrate", "convert", str(tmp_path / "rolling.yaml"), "--format", form, "--out", str(tmp_path / out)]
    assert main(convert) == 0
    message = capsys.readouterr().err
    assert message.startswith(f"--format {form} has no place for a rolling shutter: line_delay_s")
    assert main([str(tmp_path / "still.yaml") if word.endswith("rolling.yaml") else word for word in convert]) == 0
    assert "line_delay_s" not in capsys.readouterr().err


@pytest.mark.parametrize(("form", "out"), [("camera", "c.yaml"), ("colmap", "c.txt")])
def test_uncertainty_is_reported_as_missing(
    form: str, out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = simulated_rig().changed(left=None, right=None, pair_sigma=None)
    (tmp_path / "rig.yaml").write_text(rig_text(alone))
    convert = ["calibrate", "convert", str(tmp_path / "rig.yaml"), "--out", str(tmp_path / out)]
    assert main([*convert, "--format", form]) == 0
    told = f"--format {form} has no place for how sure the calibration is: left out: video_sigma; rig.yaml keeps it\n"
    assert capsys.readouterr().err == told
    assert main([*convert[:-1], str(tmp_path / "again.yaml")]) == 0
    assert "line_delay_s" not in capsys.readouterr().err
    assert read_rig(tmp_path / "again.yaml").video_sigma == alone.video_sigma


def test_rig_yaml_keeps_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rolling = simulated_rig(1.0, Optics(rolling_ns=20_000_000))
    (tmp_path / "rolling.yaml").write_text(rig_text(rolling))
    assert main(["calibrate", "convert", str(tmp_path / "rolling.yaml"), "--out", str(tmp_path / "rig.yaml")]) == 0
    assert "line_delay_s" not in capsys.readouterr().err
    assert read_rig(tmp_path / "rig.yaml").camera("left") == rolling.camera("left")


@pytest.mark.parametrize("form", ["rig", "kalibr", "opencv"])
def test_a_name_of_several_lines_stays_in_the_comment(form: str, tmp_path: Path) -> None:
    """Its second line was one of the file's: it could not be read, or said something else."""
    given, out = tmp_path / "roof\nfx: 3.yaml", tmp_path / f"rig.{'yml' if form == 'opencv' else 'yaml'}"
    rig = simulated_rig().changed(video=None)
    given.write_text(rig_text(rig))
    assert main(["calibrate", "convert", str(given), "--format", form, "--out", str(out)]) == 0
    assert main(["calibrate", "convert", str(out), "--out", str(tmp_path / "again.yaml")]) == 0
    assert read_rig(tmp_path / "again.yaml").baseline_m == pytest.approx(rig.baseline_m)
