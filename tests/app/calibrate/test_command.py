"""`ispom calibrate` from the command line: simulated images, real ones, and mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.calibration.filmed.images import open_sources
from ispom.calibration.targets.layouts import parse_target
from ispom.io.rig import read_rig
from ispom.simulation.filmed_board import LEFT, Exposing, board_image, board_poses, filming_rig
from tests.calibration.pictures import picture_of
from tests.sequences.own_folders import make_video

DATA = Path(__file__).parents[3].parent / "shared" / "data" / "calibration"
SPEC = "chessboard:9x6:0.0242"
VIEWS = 7


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with left00.png, right00.png, ..."""
    folder, rig, target = tmp_path_factory.mktemp("pairs"), filming_rig(), parse_target(SPEC)
    picture = picture_of(target)
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    for i, pose in enumerate(board_poses(LEFT, target.size_m, VIEWS, 6)):
        for name, placed in (("left", pose), ("right", right_from_left @ pose)):
            image = board_image(picture, rig.camera(name), placed, Exposing(seed=i))  # type: ignore[arg-type]
            cv2.imwrite(str(folder / f"{name}{i:02d}.png"), image)
    return folder


def test_simulated_pairs_give_the_rig_that_took_them(pairs: Path, tmp_path: Path) -> None:
    out, numbers, report = tmp_path / "rig.yaml", tmp_path / "rig.json", tmp_path / "rig.html"
    words = ["calibrate", "stereo", str(pairs), "--target", SPEC, "--out", str(out), "--json", str(numbers)]
    assert main([*words, "--report", str(report), "--model", "radtan"]) == 0
    found, truth = read_rig(out), filming_rig()
    assert found.camera("left").fx == pytest.approx(truth.camera("left").fx, rel=0.003)
    assert found.baseline_m == pytest.approx(0.11, rel=0.005)
    content = json.loads(numbers.read_text())
    assert content["verdict"] == "usable"
    assert content["reprojection_rms_px"] < 0.1
    assert set(content["cameras"]) == {"left", "right"}
    assert "film next" in report.read_text()
    assert main([*words, "--model", "radtan"]) == 0  # its own earlier output is replaced


def test_no_board_in_the_images_says_what_is_there(pairs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "stereo", str(pairs), "--target", "chessboard:7x5:0.03"]) == 2
    assert "chessboard of 9x6" in capsys.readouterr().err
    assert main(["calibrate", "stereo", str(pairs), "--target", "aprilgrid:6x6:0.03:0.3"]) == 2
    assert "none of 7 images" in capsys.readouterr().err


def test_images_of_several_sizes_are_refused(pairs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in sorted(pairs.glob("left0*.png"))[:3]:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    cv2.imwrite(str(tmp_path / "left09.png"), np.zeros((300, 400), np.uint8))
    assert main(["calibrate", "video", str(tmp_path), "--target", SPEC]) == 2
    assert "left09.png is 400 x 300" in capsys.readouterr().err


def test_too_few_views_are_to_be_filmed_again(pairs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(path) for path in sorted(pairs.glob("left0*.png"))[:2]]
    out, numbers = tmp_path / "rig.yaml", tmp_path / "rig.json"
    assert main(["calibrate", "video", *files, "--target", SPEC, "--out", str(out), "--json", str(numbers)]) == 1
    assert "redo: video: 2 of 2 images" in capsys.readouterr().out
    assert not out.exists()
    assert json.loads(numbers.read_text())["verdict"] == "redo"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["video", "nowhere", "--target", SPEC], "nowhere is missing"),
        (["video", ".", "--target", "chess"], "there is no target called 'chess'"),
        (["stereo", ".", "--target", SPEC], "holds no folder, film or images called left"),
        (["stereo", ".", ".", "--target", SPEC], "is given twice"),
        (["rig", ".", "..", "--target", SPEC], "2 places were given for video, left and right"),
        (["video", ".", "--target", SPEC, "--max-views", "2"], "give 3 or more"),
        (["video", ".", "--target", SPEC, "--report", "x.txt"], "ends in .html"),
    ],
)
def test_mistakes_are_one_sentence(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *words]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1


def test_a_folder_of_one_film_is_that_film(tmp_path: Path) -> None:
    film = make_video(tmp_path)
    for given in (film, tmp_path):
        (source,) = open_sources("video", (given,))
        assert source.is_film and source.place == film and len(source) == 6


def test_a_target_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", "target"]
    assert main([*words, "aprilgrid:6x6:0.03:0.3", "--out", str(tmp_path / "t.pdf")]) == 0
    assert (tmp_path / "t.pdf").read_bytes().startswith(b"%PDF")
    assert main([*words, SPEC, "--out", str(tmp_path / "t.svg")]) == 0
    assert main([*words, SPEC, "--out", str(tmp_path / "t.png")]) == 2
    assert main([*words, "chessboard:9x6:2", "--out", str(tmp_path / "u.pdf")]) == 2
    assert "in metres" in capsys.readouterr().err


def test_a_target_is_target_pdf_where_nothing_else_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "target", SPEC]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["target.pdf"]


@pytest.mark.parametrize("more", [[], [SPEC, SPEC], [SPEC, "--target", SPEC], [SPEC, "--from-motion"]])
def test_one_target_is_printed_and_nothing_is_solved(
    more: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "target", *more]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/calibration is not there")
def test_opencvs_pairs_are_fitted_as_well_as_by_opencv(tmp_path: Path) -> None:
    numbers = tmp_path / "c.json"
    words = ["calibrate", "stereo", str(DATA / "chessboard_stereo"), "--target", "chessboard:9x6:0.025"]
    assert main([*words, "--json", str(numbers)]) == 0
    found = json.loads(numbers.read_text())
    assert found["cameras"]["left"]["images_used"] == found["cameras"]["right"]["images_used"] == 13
    assert found["reprojection_rms_px"] < 0.3925  # of OpenCV's own file, of the left camera
    assert found["cameras"]["left"]["fx"] == pytest.approx(535.916, rel=0.005)
    assert found["row_error_rms_px"] < 0.2


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/calibration is not there")
def test_pairs_of_an_aprilgrid_agree_with_the_reference(tmp_path: Path) -> None:
    numbers, folder = tmp_path / "c.json", DATA / "aprilgrid_stereo"
    words = ["calibrate", "stereo", str(folder), "--target", "aprilgrid:6x6:0.088:0.3"]
    assert main([*words, "--json", str(numbers), "--model", "radtan"]) == 0
    found = json.loads(numbers.read_text())
    for camera, fx, fy in (("left", 458.654, 457.296), ("right", 457.587, 456.134)):
        assert found["cameras"][camera]["fx"] == pytest.approx(fx, rel=0.003)
        assert found["cameras"][camera]["fy"] == pytest.approx(fy, rel=0.003)
    assert found["baseline_m"] == pytest.approx(0.11007, rel=0.003)
    reference = json.loads((folder / "detected_corners.json").read_text())["value0"]
    away, tags, missed = [], 0, 0
    for entry in reference:
        frame, camera = entry["key"]["first"], ("left", "right")[entry["key"]["second"]]
        seen = found["cameras"][camera]["detections"].get(f"{frame:03d}.jpg")
        if seen is None:
            continue
        ids = np.array(entry["value"]["value1"])
        uv = np.array([[c["value0"], c["value1"]] for c in entry["value"]["value0"]])
        _, a, b = np.intersect1d(ids, seen["ids"], return_indices=True)
        away += np.linalg.norm(uv[a] - np.array(seen["uv"])[b], axis=1).tolist()
        tags += len(set(ids // 4))
        missed += len(set(ids // 4) - {i // 4 for i in seen["ids"]})
    assert len(away) > 10_000
    assert missed <= 0.05 * tags
    assert np.median(away) < 0.1
