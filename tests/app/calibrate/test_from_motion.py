"""`ispom calibrate rig SOURCE --from-motion`: what is written where the motion suffices, and what is said where not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.calibration import from_tracks

from ispom.calibration.motion import recorded
from ispom.calibration.motion.combine import Part
from ispom.calibration.tracked.solve import TrackedLens
from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.recognised import one_camera
from ispom.io.rig import read_rig, rig_text
from ispom.sequences import open_sequence
from ispom.simulation.cameras import simulated_rig
from ispom.types import Camera
from tests.calibration.motion import test_hand_eye as simulated

OFFSET_S = simulated.OFFSET_S


def watched(monkeypatch: pytest.MonkeyPatch, way: simulated.Way, parts: list[Part]) -> None:
    """The estimators give these trajectories, and the parts say this."""
    left, video = simulated.courses(1, way)
    joined = np.ones(len(left) - 1, bool)
    monkeypatch.setattr(recorded, "_courses", lambda *_: (left, video, joined))
    monkeypatch.setattr(recorded, "_refined", lambda *_: parts)


def part(change: float, sigma: float) -> Part:
    scale = np.array([1e-3] * 3 + [1e-4] * 3 + [1e-4])
    return Part(change * scale, np.diag((sigma * scale) ** -2), np.diag([1.0] * 7))


def test_place_and_clock_are_written_and_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    watched(monkeypatch, simulated.flight(1), [part(0.5, 0.3), part(-0.5, 0.3), part(0.1, 0.3)])
    out, numbers, report = tmp_path / "rig.yaml", tmp_path / "n.json", tmp_path / "r.html"
    words = ["calibrate", "rig", "sim:tiny", "--from-motion", "--out", str(out), "--json", str(numbers)]
    assert main([*words, "--report", str(report)]) == 0
    content = json.loads(numbers.read_text())
    assert content["verdict"] in ("good", "usable")
    assert content["clock"]["offset_s"] == pytest.approx(OFFSET_S, abs=0.0005)
    assert content["widened"] > 1.2
    assert np.array(content["covariance"]).shape == (7, 7)
    rig = read_rig(out)
    placed = rig.rig_from_left.inverse() @ rig.rig_from_video
    error = (placed.inverse() @ simulated.LEFT_FROM_VIDEO).log()
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.degrees(np.linalg.norm(error[3:])) < 0.05
    assert f"offset_s: {content['clock']['offset_s']:.6f}" in out.read_text()
    assert "Difference of the two cameras" in report.read_text()
    assert "3 parts of the recording" in capsys.readouterr().out


def test_parts_that_differ_widen_the_errors() -> None:
    left, video = simulated.courses(1, simulated.flight(1))
    rough = simulated.found_by(left, video)
    alike = recorded.combined(rough, [part(0.1, 0.3), part(-0.1, 0.3)])
    combined = recorded.combined(rough, [part(2.0, 0.3), part(-2.0, 0.3)])
    assert alike.widened == 1.0
    assert combined.widened > 5
    assert np.diag(combined.covariance) == pytest.approx(combined.widened**2 * np.diag(alike.covariance))


def test_turns_about_one_axis_are_refused_for_the_place_along_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    watched(monkeypatch, simulated.planar, [])
    out, numbers = tmp_path / "rig.yaml", tmp_path / "n.json"
    words = ["calibrate", "rig", "sim:tiny", "--from-motion", "--out", str(out), "--json", str(numbers)]
    assert main(words) == 1
    printed = capsys.readouterr().out
    assert "(0.00, 1.00, 0.00)" in printed.replace("-0.00", "0.00")
    assert "film again" in printed
    assert not out.exists()
    assert "video.y" in json.loads(numbers.read_text())["undetermined"]


def test_a_rig_that_does_not_turn_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    watched(monkeypatch, simulated.straight, [])
    assert main(["calibrate", "rig", "sim:tiny", "--from-motion"]) == 1
    assert "hardly turned" in capsys.readouterr().out


def test_the_images_refine_place_and_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded, "PART_PAIRS", 4)
    sequence, wrong = open_sequence("sim:tiny"), Pose.exp(np.array([0.004, -0.004, 0.003, 0.004, -0.003, 0.003]))
    truth = sequence.rig.rig_from_video.inverse() @ sequence.rig.rig_from_left
    left, video = simulated.courses(1, simulated.flight(1))
    rough = replace(simulated.found_by(left, video), video_from_left=wrong @ truth, offset_s=0.006)
    parts = recorded._refined(sequence, rough)
    found = recorded.combined(rough, parts)
    assert found.parts == len(parts) == 2
    error = (found.video_from_left @ truth.inverse()).log()
    assert np.degrees(np.linalg.norm(error[3:])) < 0.1 < np.degrees(np.linalg.norm(wrong.rotvec))
    assert abs(found.offset_s) < 0.003


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["stereo", "x", "--from-motion"], "--from-motion is for `ispom calibrate video` and `rig`"),
        (["video", "a", "b", "--from-motion"], "takes one film or folder of images"),
        (["video", "sim:tiny", "--from-motion", "--report", "r.html"], "--report shows images of a target"),
        (["rig", "sim:tiny", "--from-motion", "--target", "chessboard:9x6:0.02"], "leave one out"),
        (["rig", "a", "b", "--from-motion"], "takes one recording of all three cameras"),
        (["rig", "sim:nowhere", "--from-motion"], "there is no simulated sequence"),
        (["rig", "x"], "--target is missing"),
    ],
)
def test_mistakes_are_one_sentence(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", *words]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1


def test_a_video_camera_without_a_pose_is_read_only_to_find_it(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    lines = rig_text(simulated_rig()).splitlines()
    at = lines.index("  rig_from_video:")
    end = next(i for i in range(at + 1, len(lines)) if not lines[i].startswith("  "))
    path.write_text("\n".join([*lines[:at], *lines[end:]]) + "\n")
    assert np.array_equal(read_rig(path, placed=False).rig_from_video.matrix, np.eye(4))
    with pytest.raises(InputError, match="`ispom calibrate rig FOLDER --from-motion`"):
        read_rig(path)


def tracked(monkeypatch: pytest.MonkeyPatch, sigma: float | None) -> None:
    camera = Camera(320, 240, 230.0, 230.0, 160.0, 118.0, (-0.21, 0.05, 0.0, 0.0))
    errors = np.array([sigma or 0, 2.0, 2.0, 0.01, 0.01])
    lens = TrackedLens(camera, np.diag(errors**2), np.array([0.3, 5, 5, 0.25, 0.12]), 0.3, 20, 500)
    monkeypatch.setattr(from_tracks, "estimate_lens", lambda *_: lens if sigma else None)


@pytest.mark.parametrize(("sigma", "level"), [(0.008, "good"), (0.02, "usable")])
def test_a_camera_is_written_without_a_target(
    sigma: float, level: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracked(monkeypatch, sigma)
    out, numbers = tmp_path / "camera.yaml", tmp_path / "n.json"
    words = ["calibrate", "video", "sim:tiny", "--from-motion", "--format", "camera", "--out", str(out)]
    assert main([*words, "--json", str(numbers)]) == 0
    content = json.loads(numbers.read_text())
    assert content["verdict"] == level
    assert content["parameters"][0]["standard_error"] == pytest.approx(sigma * 230)
    assert one_camera(out)[0].fx == 230.0 and one_camera(out)[0].distortion[:2] == (-0.21, 0.05)
    assert "fx 230" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("sigma", "said"), [(None, "too little motion"), (0.28, "does not tell the focal length"), (0.1, "uncertain by 10")]
)
def test_a_motion_that_does_not_determine_the_lens_is_to_be_filmed_again(
    sigma: float | None, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracked(monkeypatch, sigma)
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", "video", "sim:tiny", "--from-motion", "--out", str(out)]) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("redo: ") and said in printed
    assert not out.exists()
