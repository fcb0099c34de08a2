"""`sim:calibration`: images of a target whose truth is known, for the command and the page."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.calibration.job import CalibrationRequest, Job
from ispom_app.features.calibration.kept import NUMBERS, REPORT, RIG, files_of, kept_in
from ispom_app.features.calibration.routes import image_of, seen_in, shown

from ispom.calibration.filmed.simulated import simulated
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError
from ispom.io.files import bounded
from ispom.io.rig import read_rig
from ispom.simulation.filmed_board import VIDEO

SPEC = "chessboard:7x5:0.03"


def test_the_images_are_those_of_the_chosen_cameras_and_repeat() -> None:
    made = simulated("rig", Path("sim:calibration?views=3&seed=4"), parse_target(SPEC))
    assert [source.camera for source in made.sources] == ["video", "left", "right"]
    image = made.sources[0].read(1)
    assert len(made.sources[0]) == 3 and image.shape == (VIDEO.height, VIDEO.width)
    np.testing.assert_array_equal(image, made.sources[0].read(1))
    assert (image != made.sources[0].read(2)).any()


def test_blur_and_similar_views() -> None:
    sharp, blurred = (
        simulated("video", Path(f"sim:calibration?views=2&noise=0{more}"), parse_target(SPEC)).sources[0].read(1)
        for more in ("", "&blur_ms=60")
    )
    edges = [np.abs(np.diff(image.astype(float), axis=1)).max() for image in (sharp, blurred)]
    assert edges[1] < 0.8 * edges[0]
    alike = simulated("video", Path("sim:calibration?views=2&alike"), parse_target(SPEC)).sources[0]
    assert np.abs(alike.read(0).astype(float) - alike.read(1)).mean() < 25


@pytest.mark.parametrize("source", ["sim:city", "sim:calibration?view=3", "sim:calibration?views=many"])
def test_another_name_or_setting_is_refused(source: str) -> None:
    with pytest.raises(InputError, match="sim:calibration"):
        simulated("video", Path(source), parse_target(SPEC))


def test_a_setting_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match="views"):
        simulated("video", Path("sim:calibration?views=5000"), parse_target(SPEC))


def test_the_command_prints_the_truth_with_its_result(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["calibrate", "video", "sim:calibration?views=10", "--target", SPEC, "--model", "radtan"])
    printed = capsys.readouterr().out
    assert code == 0, printed
    assert "video minus its truth: fx" in printed and "sigma" in printed


def test_a_job_shows_images_points_and_the_result_and_keeps_it(tmp_path: Path) -> None:
    (tmp_path / "another").mkdir()
    (tmp_path / "another" / NUMBERS).write_text("{}")
    job = Job(folder=tmp_path)
    job.start(CalibrationRequest("video", ("sim:calibration?views=8",), SPEC))
    with pytest.raises(InputError, match="at work"):
        job.start(CalibrationRequest("video", ("sim:calibration",), SPEC))
    job.wait(120)
    message = shown(job.progress)
    assert message["doing"] == "" and message["fault"] == "" and message["verdict"]["level"] in ("good", "usable")
    (camera,) = message["cameras"]
    assert camera["name"] == "video" and len(camera["views"]) == 8 and len(camera["drawings"]) == 7
    assert any("fx" in line for line in message["truth"])
    seen = seen_in(job.progress, "video", 0)
    assert len(seen["used"]) > 20 and len(seen["used"][0]) == 4
    assert image_of(job.progress, "video", 0).shape == (VIDEO.height, VIDEO.width)
    with pytest.raises(InputError, match="no image 8"):
        image_of(job.progress, "video", 8)
    (kept,) = kept_in(tmp_path)
    assert (kept.name, kept.level, kept.files) == (message["kept"], message["verdict"]["level"], (RIG, NUMBERS, REPORT))
    assert SPEC in kept.what and set(files_of(tmp_path)) == {f"{kept.name}/{name}" for name in kept.files}
    assert read_rig(tmp_path / kept.name / RIG).video == job.progress.found.cameras[0].camera
    assert SPEC in (tmp_path / kept.name / NUMBERS).read_text()


def test_a_calibration_to_be_filmed_again_is_kept_without_its_rig(tmp_path: Path) -> None:
    job = Job(folder=tmp_path)
    job.start(CalibrationRequest("video", ("sim:calibration?views=8&alike",), SPEC))
    job.wait(120)
    (kept,) = kept_in(tmp_path)
    assert (kept.level, kept.files) == ("redo", (NUMBERS, REPORT))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (CalibrationRequest("all", ("x",), SPEC), "cannot be calibrated"),
        (CalibrationRequest("video", ("/nowhere/at/all",), SPEC), "/nowhere/at/all"),
        (CalibrationRequest("video", ("sim:calibration?views=3",), "chessboard"), "chessboard"),
        (CalibrationRequest("video", (), SPEC), "no images were given"),
    ],
)
def test_a_mistake_is_one_sentence(asked: CalibrationRequest, said: str) -> None:
    job = Job()
    job.start(asked)
    job.wait(60)
    assert said in job.progress.fault and not job.progress.doing


def test_a_link_in_a_folder_that_may_be_opened_does_not_lead_out_of_it(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    for name in ("secret.png", "data/a.png"):
        cv2.imwrite(str(tmp_path / name), np.zeros((60, 80), np.uint8))
    (data / "b.png").symlink_to(tmp_path / "secret.png")
    job = Job(folder=tmp_path / "kept", bounds=lambda: bounded((data,)))
    job.start(CalibrationRequest("video", (str(data),), SPEC))
    job.wait(60)
    assert job.progress.fault and "outside" in job.progress.views[0].detections[1].reason
    with pytest.raises(InputError, match="outside"):
        image_of(job.progress, "video", 1)


BAD: dict[str, Callable[[Path], object]] = {
    "pipe": lambda path: os.mkfifo(path, 0o600),
    "latin-1": lambda path: path.write_bytes(b"\xe9"),
    "deep": lambda path: path.write_text('{"a":' * 100_000),
    "a list": lambda path: path.write_text("[]"),
    "other kinds": lambda path: path.write_text('{"target": {}, "cameras": 3, "verdict": []}'),
    "many words": lambda path: path.write_text(json.dumps({"target": "x" * 10**6, "cameras": {}, "verdict": ""})),
    "a folder": lambda path: path.mkdir(),
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "an endless file": lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 1 << 40),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are POSIX's")
@pytest.mark.timeout(60)
@pytest.mark.parametrize("what", BAD)
def test_one_bad_folder_does_not_hide_the_others(what: str, tmp_path: Path) -> None:
    for name in ("2020-01-01", "2030-01-01"):
        (tmp_path / name).mkdir()
        good = {"target": SPEC, "cameras": {"video": {}}, "verdict": "good"}
        (tmp_path / name / NUMBERS).write_text(json.dumps(good))
    (tmp_path / "2025-01-01").mkdir()
    BAD[what](tmp_path / "2025-01-01" / NUMBERS)
    assert [each.name for each in kept_in(tmp_path)] == ["2030-01-01", "2020-01-01"]


def test_what_may_not_be_opened_is_refused() -> None:
    def check(path: str) -> None:
        raise InputError(f"{path} is outside")

    job = Job(check)
    job.start(CalibrationRequest("video", ("/etc",), SPEC))
    job.wait(10)
    assert job.progress.fault == "/etc is outside"
