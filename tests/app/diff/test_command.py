"""`ispom diff` on real runs: a planted change is named with its frame and the first quantity."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_folder import DECISIONS, MARKER

from ispom.sequences import open_sequence
from ispom.types import Trajectory, is_video
from tests.app import helpers
from tests.app.helpers import ran
from tests.rounds import FRAME_NS, SCENARIOS, world_from_rig
from tests.sequences.kitti_folder import make_drive
from tests.sequences.own_folders import write_sequence

EXPOSURES = 24


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The video of sim:tiny, as images with a calibration."""
    folder, sequence = tmp_path_factory.mktemp("frames"), open_sequence("sim:tiny")
    camera, times = sequence.rig.video, []
    for i in range(len(sequence)):
        if sequence.kinds[i] == "video" and len(times) < EXPOSURES:
            exposure = sequence[i]
            assert is_video(exposure)
            image = exposure.image if exposure.image.ndim == 2 else cv2.cvtColor(exposure.image, cv2.COLOR_RGB2BGR)
            cv2.imwrite(str(folder / f"{len(times):03d}.png"), image)
            times.append(exposure.time_ns / 1e9)
    assert camera is not None
    (folder / "times.txt").write_text("".join(f"{t:.9f}\n" for t in times))
    distortion = ", ".join(map(str, camera.distortion))
    (folder / "camera.yaml").write_text(
        f"{{width: {camera.width}, height: {camera.height}, fx: {camera.fx}, fy: {camera.fy}, cx: {camera.cx}, "
        f"cy: {camera.cy}, distortion: [{distortion}]}}\n"
    )
    return folder


Runner = Callable[..., Path]


@pytest.fixture(scope="module")
def run(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> Runner:
    def made(*options: str, source: Path = frames) -> Path:
        out = tmp_path_factory.mktemp("run") / "out"
        chosen = ["--methods", "monocular.paper", "--no-recording", *options]
        return ran(source, out, *chosen)

    return made


@pytest.fixture(scope="module")
def first(run: Runner) -> Path:
    return run()


def compared(capsys: pytest.CaptureFixture[str], code: int, *arguments: object) -> str:
    capsys.readouterr()
    assert main(["diff", *map(str, arguments)]) == code
    printed = capsys.readouterr()
    return printed.err if code == 2 else printed.out


def test_equal_runs_have_no_differences(run: Runner, first: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert compared(capsys, 0, first, run()) == "alike: monocular.paper\n"
    report = json.loads(compared(capsys, 0, first, run(), "--json"))
    assert report["alike"] and not report["first"] and not report["settings"]


def test_a_threshold_that_is_a_millionth_off_is_named(
    run: Runner, first: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = run("--monocular.paper.min-parallax-deg", "0.500001")
    report = json.loads(compared(capsys, 1, first, other, "--json"))
    assert report["settings"] == [{"name": "monocular.paper.min_parallax_deg", "a": 0.5, "b": 0.500001}]
    (difference,) = report["first"][0]["differences"]
    assert difference["name"] == "monocular.paper.parallax.threshold"
    assert (difference["a"], difference["b"], difference["by"]) == (0.5, 0.500001, pytest.approx(1e-6))
    assert report["first"][0]["exposure"] == 1, "the first frame at which parallax is compared"
    text = compared(capsys, 1, first, other).splitlines()
    assert text[0] == "setting monocular.paper.min_parallax_deg: 0.5 | 0.500001"
    assert text[1] == "frame 1 (0.033 s)"
    assert text[2] == "  monocular.paper.parallax.threshold: 0.5 | 0.500001, apart by 1e-06"


def test_a_threshold_that_decides_otherwise_is_followed_to_the_exposure_where_it_does(
    run: Runner, first: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A millionth apart, on both sides of what was measured at one frame."""
    with (first / DECISIONS).open(newline="") as file:
        checks = [row for row in csv.DictReader(file) if row["key"] == "parallax" and row["passed"] == "1"]
    exposure, measured = int(checks[1]["exposure"]), float(checks[1]["value"])
    below, above = (run(f"--monocular.paper.min-parallax-deg={measured + sign * 5e-7!r}") for sign in (-1, 1))
    report = json.loads(compared(capsys, 1, below, above, "--json"))
    assert report["first"][0]["differences"][0]["name"] == "monocular.paper.parallax.threshold"
    assert report["first"][1]["exposure"] == exposure
    decided = {difference["name"]: difference for difference in report["first"][1]["differences"]}
    assert decided["monocular.paper.parallax.passed"]["a"] and not decided["monocular.paper.parallax.passed"]["b"]
    report = json.loads(compared(capsys, 1, below, above, "--json", "--tolerance", "1e-5"))
    (found, *_) = report["first"]
    assert (found["exposure"], found["differences"][0]["name"]) == (exposure, "monocular.paper.parallax.passed")


def test_a_difference_within_the_tolerance_does_not_count(
    run: Runner, first: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = run("--monocular.paper.min-parallax-deg", "0.500001")
    compared(capsys, 0, first, other, "--tolerance", "1e-5")


def test_one_pixel_of_one_image_is_found(
    frames: Path, run: Runner, first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = tmp_path / "frames"
    shutil.copytree(frames, changed)
    image = cv2.imread(str(changed / "007.png"), cv2.IMREAD_UNCHANGED)
    row, column = corner(image)
    image[row, column] = 255 - image[row, column]
    cv2.imwrite(str(changed / "007.png"), image)
    report = json.loads(compared(capsys, 1, first, run(source=changed), "--json"))
    assert report["first"][0]["exposure"] == 7 and report["first"][0]["differences"][0]["name"].endswith(
        "tracks_digest"
    )
    assert "images_sha256" in {setting["name"] for setting in report["settings"]}


def test_one_pixel_of_a_right_image_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = next(s for s in SCENARIOS if len(s.kinds) == 2).sequence(22)
    times = np.unique(made.times_ns).tolist()
    truth = Trajectory.of([(t, world_from_rig(t // FRAME_NS)) for t in times])
    flight = write_sequence(tmp_path / "flight", replace(made, truth=truth))
    outs = [tmp_path / "a", tmp_path / "b"]
    for out in outs:
        ran(flight, out, "--methods", "stereo", "--no-recording")
        right = cv2.imread(str(flight / "right" / "2.png"), cv2.IMREAD_UNCHANGED)
        row, column = corner(right)
        right[row, column] = 255 - right[row, column]
        cv2.imwrite(str(flight / "right" / "2.png"), right)
    report = json.loads(compared(capsys, 1, *outs, "--json"))
    third = [i for i, kind in enumerate(made.kinds) if kind == "stereo"][2]
    assert report["first"][0]["exposure"] == third and report["first"][0]["differences"]


def corner(image: np.ndarray) -> tuple[int, int]:
    """A pixel that trackers look at."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    ((column, row),) = cv2.goodFeaturesToTrack(grey[40:-40, 40:-40], 1, 0.01, 5).reshape(1, 2)
    return int(row) + 40, int(column) + 40


def test_another_seed_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outs = [tmp_path / "a", tmp_path / "b"]
    for seed, out in enumerate(outs):
        options = ["--methods", "monocular.paper", "--no-recording", "--until", "exposure == 2", "--seed", str(seed)]
        ran("sim:tiny", out, *options)
    report = json.loads(compared(capsys, 1, *outs, "--json"))
    assert {"name": "seed", "a": 0, "b": 1} in report["settings"] and report["first"][0]["exposure"] == 0


def test_a_run_that_was_stopped_ends_where_the_other_goes_on(
    run: Runner, first: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stopped = run("--until", "exposure == 9")
    report = json.loads(compared(capsys, 1, first, stopped, "--json"))
    assert report["first"][0]["exposure"] == 10 and report["apart"] == EXPOSURES - 10
    assert report["first"][0]["differences"][0]["name"] == "monocular.paper.step"


def test_a_final_trajectory_that_differs_is_named(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    shutil.copytree(first, other)
    lines = (other / "monocular.paper.tum").read_text().splitlines()
    words = lines[5].split()
    words[1] = str(float(words[1]) + 0.25)
    (other / "monocular.paper.tum").write_text("\n".join([*lines[:5], " ".join(words), *lines[6:]]) + "\n")
    report = json.loads(compared(capsys, 1, first, other, "--json"))
    (found,) = report["first"]
    assert found["exposure"] is None and report["apart"] == 0
    (difference,) = found["differences"]
    assert difference["name"] == "monocular.paper.final_position" and difference["by"] == pytest.approx(0.25)


def test_an_incomplete_run_is_reported_as_incomplete(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    shutil.copytree(first, other)
    (other / MARKER).write_text("Stopped.\n")
    assert "is not complete" in compared(capsys, 0, first, other)


@pytest.mark.parametrize("option", [("--tolerance", "-1"), ("--tolerance", "nan"), ("--count", "0")])
def test_options_out_of_range_are_refused(
    first: Path, option: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert option[0] in compared(capsys, 2, first, first, *option)


def test_a_folder_that_holds_no_run_is_refused(first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "holds no run" in compared(capsys, 2, first, tmp_path)
    drive = make_drive(tmp_path / "drive")
    options = ["--out", str(tmp_path / "o"), "--methods", "stereo.paper", "--no-recording"]
    assert main(["run", str(drive), *options], helpers.build) == 0
    assert "in common" in compared(capsys, 2, first, tmp_path / "o")
