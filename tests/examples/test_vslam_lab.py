"""The baseline for VSLAM-LAB: started as VSLAM-LAB starts one, and its trajectory read by evo, as VSLAM-LAB does it."""

from __future__ import annotations

import csv
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
import yaml
from evo.core import metrics, sync
from evo.tools import file_interface
from ispom_app.cli.main import main

from ispom.geometry import Pose
from ispom.io.poses.recognised import read_trajectory
from ispom.io.trajectories import vslam_lab_text
from ispom.sequences import open_sequence
from ispom.testing.flight import SPEED_M_PER_FRAME, flight, flight_rig
from ispom.types import Camera, Trajectory, is_stereo

EXAMPLE = Path(__file__).parents[2] / "examples" / "vslam_lab"
HEADER = ["ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw"]


def entry(name: str, camera: Camera, body_from_camera: Pose) -> dict:
    """A camera in calibration.yaml."""
    lens = {"distortion_type": "radtan5", "distortion_coefficients": [*camera.distortion, 0.0, 0.0][:5]}
    return (lens if camera.distortion else {}) | {
        "cam_name": name,
        "cam_type": "gray",
        "cam_model": "pinhole",
        "focal_length": [camera.fx, camera.fy],
        "principal_point": [camera.cx, camera.cy],
        "image_dimension": [camera.width, camera.height],
        "fps": 30.0,
        "T_BS": body_from_camera.matrix.ravel().tolist(),
    }


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight past balls: a pair in rgb_0 and rgb_1, and the poses of the body."""
    folder, rig = tmp_path_factory.mktemp("FLIGHT") / "balls", flight_rig()
    frames = [frame for frame in flight(rig) if is_stereo(frame)]
    rows = []
    for name in ("rgb_0", "rgb_1"):
        (folder / name).mkdir(parents=True)
    for i, frame in enumerate(frames):
        cv2.imwrite(str(folder / "rgb_0" / f"{i:05d}.png"), frame.left)
        cv2.imwrite(str(folder / "rgb_1" / f"{i:05d}.png"), frame.right)
        rows.append([frame.time_ns, f"rgb_0/{i:05d}.png", frame.time_ns, f"rgb_1/{i:05d}.png"])
    sides = (("rgb_0", "left"), ("rgb_1", "right"))
    cameras = [entry(name, rig.camera(side), rig.rig_from(side)) for name, side in sides]
    (folder / "calibration.yaml").write_text(yaml.safe_dump({"cameras": cameras}))
    write_table(folder / "rgb.csv", [["ts_rgb_0 (ns)", "path_rgb_0", "ts_rgb_1 (ns)", "path_rgb_1"], *rows])
    (folder / "groundtruth.csv").write_text(vslam_lab_text(truth([frame.time_ns for frame in frames])))
    return folder


def truth(times_ns: list[int]) -> Trajectory:
    """Poses of the rig, as `flight` renders them."""
    poses = []
    for time_ns in times_ns:
        n = time_ns / 33_000_000
        turn, place = np.array([0.0, 0.003 * n, 0.0]), np.array([0.001 * n**2, 0.0, SPEED_M_PER_FRAME * n])
        poses.append((time_ns, Pose.from_rotvec(turn, place)))
    return Trajectory.of(poses)


def write_table(path: Path, rows: list[list]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def as_tum(table: Path, target: Path) -> Path:
    """As VSLAM-LAB gives a table to evo: without its header, with spaces."""
    target.write_text("".join(line.replace(",", " ") + "\n" for line in table.read_text().splitlines()[1:]))
    return target


def test_the_baseline_writes_what_vslam_lab_evaluates(sequence: Path, tmp_path: Path) -> None:
    experiment = tmp_path / "exp" / "FLIGHT" / "balls"
    experiment.mkdir(parents=True)
    (experiment / "rgb_exp.csv").write_bytes((sequence / "rgb.csv").read_bytes())
    (experiment / "calibration_exp.yaml").write_bytes((sequence / "calibration.yaml").read_bytes())
    words = {
        "sequence_path": sequence,
        "calibration_yaml": experiment / "calibration_exp.yaml",
        "rgb_csv": experiment / "rgb_exp.csv",
        "exp_folder": experiment,
        "exp_it": 3,
        "settings_yaml": EXAMPLE / "vslamlab_ispom_settings.yaml",
        "verbose": 1,
        "mode": "stereo",
    }
    command = [sys.executable, str(EXAMPLE / "vslamlab_ispom.py")]
    command += [word for name, value in words.items() for word in (f"--{name}", str(value))]
    found = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert found.returncode == 0, found.stderr
    result = experiment / "00003_KeyFrameTrajectory.csv"
    with result.open(newline="") as file:
        assert next(csv.reader(file)) == HEADER
    estimate = file_interface.read_tum_trajectory_file(as_tum(result, tmp_path / "estimate.txt"))
    reference = file_interface.read_tum_trajectory_file(as_tum(sequence / "groundtruth.csv", tmp_path / "truth.txt"))
    reference, estimate = sync.associate_trajectories(reference, estimate, max_diff=1e9 / 30)
    estimate.align(reference, correct_scale=True)  # evo_ape -va -as
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((reference, estimate))
    assert estimate.num_poses == reference.num_poses >= 10
    assert error.get_statistic(metrics.StatisticsType.rmse) < 0.01 * reference.path_length


def test_a_trajectory_comes_back(sequence: Path, tmp_path: Path) -> None:
    """What is written as groundtruth.csv is read as such, and the poses are those of the left camera."""
    opened = open_sequence(str(sequence))
    expected = truth(sorted(set(opened.times_ns.tolist())))
    assert opened.truth is not None
    np.testing.assert_allclose(opened.truth.translations, expected.translations, atol=1e-6)
    run = tmp_path / "run"
    options = ["--methods", "stereo", "--no-recording", "--max-exposures", "6", "--out", str(run)]
    assert main(["run", str(sequence), *options]) == 0
    assert main(["export", str(run), "--format", "vslam-lab"]) == 0
    found = read_trajectory(run / "export" / "vslam-lab" / "stereo" / "00000_KeyFrameTrajectory.csv")
    assert found.format == "CSV" and found.unit == ""
    own = read_trajectory(run / "stereo.tum").trajectory
    left = own.moved(right=flight_rig().rig_from_left)
    np.testing.assert_allclose(found.trajectory.translations, left.translations, atol=1e-8)


def test_the_class_agrees_with_settings_and_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    """VSLAM-LAB's base class, which is not installed here, is replaced by its constructor."""

    class Base:
        def __init__(self, name: str, folder: str, parameters: dict) -> None:
            self.baseline_path, self.parameters = Path(folder), parameters

    module = ModuleType("Baselines.BaselineVSLAMLAB")
    monkeypatch.setattr(module, "BaselineVSLAMLAB", Base, raising=False)
    monkeypatch.setitem(sys.modules, "Baselines", ModuleType("Baselines"))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    baseline = runpy.run_path(str(EXAMPLE / "baseline_ispom.py"))["ISPOM_baseline"]()
    settings = yaml.safe_load((EXAMPLE / "vslamlab_ispom_settings.yaml").read_text())
    tasks = tomllib.loads((EXAMPLE / "pixi.toml").read_text())["feature"]["ispom"]["tasks"]
    assert set(baseline.modes) == set(settings) and {f"execute-{mode}" for mode in baseline.modes} == set(tasks)
    assert baseline.parameters["mode"] in baseline.modes and not baseline.is_installed()[0]
