"""`ispom calibrate rig` on simulated pictures: frames of its own for the video, or all at once; what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.calibration.targets.layouts import parse_target
from ispom.io.rig import read_rig
from ispom.simulation.filmed_board import Exposing, Filming, board_image, filming_rig
from tests.calibration.filmed import FIRST_S, around, video_from_left
from tests.calibration.pictures import picture_of

SPEC = "aprilgrid:4x4:0.04:0.3"
OFFSET_S = 0.035
PAIRS, PAIR_S, VIDEO_S = 12, 0.4, 1 / 25


def filmed(folder: Path, video_s: np.ndarray, pairs_s: np.ndarray, film: Filming) -> None:
    """Folders video, left and right, each with times.txt."""
    target = parse_target(SPEC)
    picture, rig = picture_of(target), film.rig
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    own = [film.video_from_board_at(t + film.clock_offset_s) for t in video_s]
    left = [film.left_from_board_at(t) for t in pairs_s]
    right = [right_from_left @ pose for pose in left]
    cameras = (("video", own, video_s + film.clock_offset_s), ("left", left, pairs_s), ("right", right, pairs_s))
    for name, poses, stamps_s in cameras:
        (folder / name).mkdir()
        np.savetxt(folder / name / "times.txt", stamps_s, fmt="%.6f")
        for i, pose in enumerate(poses):
            image = board_image(picture, rig.camera(name), pose, Exposing(seed=i))  # type: ignore[arg-type]
            cv2.imwrite(str(folder / name / f"{i:03d}.png"), image)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("session")
    film = Filming.of(filming_rig(), parse_target(SPEC).size_m, PAIRS * PAIR_S + 0.5, 3, OFFSET_S)
    pairs_s = FIRST_S + PAIR_S * np.arange(PAIRS)
    filmed(folder, around(pairs_s, VIDEO_S, 3), pairs_s, film)
    return folder


def test_a_video_with_a_clock_of_its_own_is_placed_with_its_offset(session: Path, tmp_path: Path) -> None:
    out, numbers, report = tmp_path / "rig.yaml", tmp_path / "rig.json", tmp_path / "rig.html"
    words = ["calibrate", "rig", str(session), "--target", SPEC, "--out", str(out), "--model", "radtan"]
    assert main([*words, "--json", str(numbers), "--report", str(report), "--clock-within", "0.1"]) == 0
    found, truth, content = read_rig(out), filming_rig(), json.loads(numbers.read_text())
    assert content["clock"]["offset_s"] == pytest.approx(-OFFSET_S, abs=0.001)
    assert content["clock"]["determined"]
    assert "offset_s: -0.035" in out.read_text()
    assert "video&#39;s clock" in report.read_text()
    placed = found.rig_from_video.inverse() @ found.rig_from_left
    error = placed @ (truth.rig_from_video.inverse() @ truth.rig_from_left).inverse()
    sigma = [p["standard_error"] for p in content["parameters"] if p["camera"] == "video"][-6:]
    assert (np.abs(error.log()) < 4 * np.array(sigma)).all()
    assert np.degrees(np.linalg.norm(error.rotvec)) < 0.2


def test_cameras_that_turn_differently_are_reported(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    film = Filming.of(filming_rig(), parse_target(SPEC).size_m, PAIRS * PAIR_S + 0.5, 8, OFFSET_S)
    pairs_s = FIRST_S + PAIR_S * np.arange(PAIRS)
    filmed(other, around(pairs_s, VIDEO_S, 3), pairs_s[:1], film)
    words = ["calibrate", "rig", str(other / "video"), str(session / "left"), str(session / "right")]
    assert main([*words, "--target", SPEC, "--model", "radtan", "--clock-within", "0.05"]) == 1
    assert "turn alike" in capsys.readouterr().out


def test_images_of_the_three_cameras_taken_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = Filming.of(filming_rig(), parse_target(SPEC).size_m, 10.0, 5)
    pairs_s = 0.4 + 0.8 * np.arange(10)
    filmed(tmp_path, pairs_s, pairs_s, film)
    numbers = tmp_path / "rig.json"
    words = ["calibrate", "rig", str(tmp_path), "--target", SPEC, "--model", "radtan", "--json", str(numbers)]
    assert main(words) == 0
    content = json.loads(numbers.read_text())
    assert content["clock"] is None
    placed, truth = content["camera_from_first"]["video"], video_from_left(film)
    assert placed["translation_m"] == pytest.approx(truth.translation, abs=0.001)
    assert "good" in capsys.readouterr().out or content["verdict"] == "usable"


def test_the_clocks_range_is_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "rig", ".", "--target", SPEC, "--clock-within", "-1"]) == 2
    assert "--clock-within is -1: give 0 to 120" in capsys.readouterr().err
