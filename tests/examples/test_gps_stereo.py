"""The examples of a method with GNSS and of a data set format: fixes among the frames, from a file to the results."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
import yaml

from ispom import (
    Config,
    Frame,
    GnssAntenna,
    GnssFix,
    Pose,
    Rig,
    Sequence,
    Status,
    Step,
    Trajectory,
    aligned,
    ate_m,
    build,
    methods,
)
from ispom.estimator import Method
from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Camera
from tests.examples.packages import EXAMPLES, install, python

LEVER = Pose(translation=np.array([0.3, -1.2, -0.4]))
LOCAL_FROM_WORLD = Pose.from_rotvec(np.array([0, 0, 0.8]), np.array([100.0, -40.0, 12.0])) @ Pose(
    np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
)
"""Of a world whose y axis is down."""
SIGMA_M = 0.01
NOTHING = np.zeros((48, 64), np.uint8)


@pytest.fixture(scope="module")
def example() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXAMPLES / "gps_stereo")
        return import_module("gps_stereo")


def fix(time_ns: int, world_from_rig: Pose, sigma_m: float, rng: np.random.Generator) -> GnssFix:
    antenna = LOCAL_FROM_WORLD.apply((world_from_rig @ LEVER).translation)
    return GnssFix(time_ns, antenna + rng.normal(0, sigma_m, 3), sigma_m**2 * np.eye(3))


def error_m(estimate: Trajectory, truth: Trajectory) -> float:
    """ATE, aligned by SE(3), at the times of the estimate."""
    same = Trajectory.of([(t, pose) for t in estimate.times_ns.tolist() if (pose := truth.at(t)) is not None])
    return ate_m(aligned(estimate, same, "se3"), same)


def drive(method: Method, *, outlier: int = -1, seed: int = 1) -> tuple[Trajectory, Trajectory, Trajectory, list[Step]]:
    """The fused, the stereo and the true trajectory of 600 m with turns, and the Steps; stereo drifts in heading."""
    rng = np.random.default_rng(seed)
    rig = Rig.stereo(Camera(64, 48, 50.0, 50.0, 31.5, 23.5), 0.5).changed(gnss=GnssAntenna(rig_from_sensor=LEVER))
    estimator = method.config().build(rig)
    state, true, odometry, steps = estimator.start(), Pose(), Pose(), []
    truth, drifted = [], []
    for k in range(600):
        time_ns = k * 100_000_000
        motion = Pose.exp(np.array([0, 0, 1.0, 0, 0.02 * np.sin(k / 60), 0]))
        noise = np.concatenate([rng.normal(0, 0.002, 3), rng.normal(0, 2e-4, 3)])
        drift = np.array([0, 0, 0.004, 0, 3e-4, 0])
        if k % 10 == 5:
            half = true @ Pose.exp(0.5 * motion.log())
            sigma_m = 20.0 if k // 10 == outlier else 0.3
            measured = fix(time_ns + 50_000_000, half, sigma_m, rng)
            state, _ = estimator.step(state, GnssFix(measured.time_ns, measured.xyz_in_local, 0.09 * np.eye(3)), {})
        true, odometry = true @ motion, odometry @ motion @ Pose.exp(noise + drift)
        part = Step(time_ns + 100_000_000, Status.TRACKING, "rig", odometry)
        state, step = estimator.step(
            state, Frame.stereo(part.time_ns, *2 * [np.zeros((48, 64), np.uint8)]), {"stereo": part}
        )
        steps.append(step)
        truth.append((part.time_ns, true))
        drifted.append((part.time_ns, odometry))
    stereo = Trajectory.of(drifted)
    return estimator.finish(state, {"stereo": stereo}), stereo, Trajectory.of(truth), steps


def test_fixes_remove_the_drift_of_stereo(example: ModuleType) -> None:
    fused, stereo, truth, steps = drive(example.METHOD)
    assert error_m(stereo, truth) > 3
    assert error_m(fused, truth) < 0.6
    decisions = [d for step in steps for d in step.decisions]
    assert len(decisions) > 40 and all(d.passed for d in decisions)
    assert 1.5 < np.mean([d.value for d in decisions]) < 6, "3 where the covariances are right"
    assert steps[-1].covariance is not None and 0.05 < np.sqrt(np.trace(steps[-1].covariance[:3, :3])) < 1


def test_a_fix_that_contradicts_is_left_out(example: ModuleType) -> None:
    fused, _, truth, steps = drive(example.METHOD, outlier=30)
    failed = [d for step in steps for d in step.decisions if not d.passed]
    assert [d.key for d in failed] == ["fix"] and failed[0].value > 100
    assert error_m(fused, truth) < 0.6


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """A short simulated flight."""
    return open_simulated("tiny", 0, tmp_path_factory.mktemp("rendered"), duration_s=2.4)


@pytest.fixture(scope="module")
def folder(pairs: Sequence, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """In the format of the example: its stereo frames, and fixes between them."""
    folder, rows, rng = tmp_path_factory.mktemp("logs") / "drive", [], np.random.default_rng(0)
    folder.mkdir()
    assert pairs.truth is not None
    for i, (time_ns, kind) in enumerate(zip(pairs.times_ns.tolist(), pairs.kinds, strict=True)):
        if kind == "stereo":
            frame = pairs[i]
            assert isinstance(frame, Frame)
            for side, image in frame.images.items():
                cv2.imwrite(str(folder / f"{side}{i:03}.png"), image)
            rows.append((time_ns, "stereo", f"left{i:03}.png", f"right{i:03}.png"))
        elif i % 3 == 0 and (pose := pairs.truth.at(time_ns)) is not None:
            measured = fix(time_ns, pose, SIGMA_M, rng)
            rows.append((time_ns, "gnss", *measured.xyz_in_local, SIGMA_M))
    with (folder / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([(f"{row[0] * 1e-9:.9f}", *row[1:]) for row in sorted(rows)])
    camera, names = pairs.rig.camera("left"), ("width", "height", "fx", "fy", "cx", "cy")
    described = {"camera": {n: getattr(camera, n) for n in names}, "baseline_m": pairs.rig.baseline_m}
    described["antenna_in_rig_m"] = LEVER.translation.tolist()
    (folder / "rig.json").write_text(json.dumps(described))
    return folder


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("installed"), "gps_stereo", "own_dataset")


def test_the_method_keeps_the_contract(installed: Path, folder: Path) -> None:
    code = (
        "import sys, ispom; sequence = ispom.open_sequence(sys.argv[1]);"
        "ispom.check_estimator('gps_stereo', sequence=sequence)"
    )
    found = python(installed, "-c", code, folder)
    assert found.returncode == 0, found.stderr


def test_a_folder_of_another_format_is_run_with_its_fixes(installed: Path, folder: Path, tmp_path: Path) -> None:
    run, fork = tmp_path / "run", tmp_path / "fork"
    words = ("run", folder, "--methods", "stereo", "gps_stereo", "--gps-stereo.start-m", "0.5", "--out", run)
    found = python(installed, "-m", "ispom_app", *words)
    assert found.returncode == 0, found.stderr
    with (folder / "log.csv").open() as file:
        kinds = [row[1] for row in csv.reader(file)]
    assert f"{kinds.count('gnss')} gnss" in found.stdout
    manifest = yaml.safe_load((run / "run.yaml").read_text())
    assert manifest["exposures"] == {"video": 0, "stereo": kinds.count("stereo"), "gnss": kinds.count("gnss")}
    assert "sensor: gnss" in (run / "rig.yaml").read_text()
    with (run / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert sum(row["method"] == "gps_stereo" for row in rows) == len(kinds)
    assert sum(row["method"] == "stereo" for row in rows) == kinds.count("stereo")
    with (run / "decisions.csv").open() as file:
        assert any(row["key"] == "fix" for row in csv.DictReader(file))
    found = python(installed, "-m", "ispom_app", "fork", run, "--at", str(len(kinds) // 2), "--out", fork)
    assert found.returncode == 0, found.stderr
    assert (fork / "gps_stereo.tum").read_bytes() == (run / "gps_stereo.tum").read_bytes()


def test_the_sources_of_the_format_are_described_and_its_mistakes_named(
    installed: Path, folder: Path, tmp_path: Path
) -> None:
    found = python(installed, "-m", "ispom_app", "sources", folder)
    assert found.returncode == 0 and "gnss" in found.stdout and "gps_stereo" in found.stdout, found.stderr
    wrong = tmp_path / "wrong"
    wrong.mkdir()
    (wrong / "rig.json").write_text((folder / "rig.json").read_text())
    (wrong / "log.csv").write_text("0.0,sonar,3\n")
    found = python(installed, "-m", "ispom_app", "run", wrong, "--out", tmp_path / "out")
    assert found.returncode == 2 and "'sonar'" in found.stderr, found.stderr


def test_a_method_whose_sensor_is_missing_is_refused(installed: Path, recording: Path, tmp_path: Path) -> None:
    words = ("run", recording, "--methods", "gps_stereo", "--out", tmp_path / "out")
    found = python(installed, "-m", "ispom_app", *words)
    assert found.returncode == 2 and "gps_stereo needs" in found.stderr, found.stderr


@pytest.fixture
def added(example: ModuleType) -> Iterator[Method]:
    """The method, in this process alone."""
    methods.add(example.METHOD)
    yield example.METHOD
    methods.REGISTRY.remove(example.METHOD)


def test_fixes_are_put_among_the_frames_in_python(pairs: Sequence, example: ModuleType, added: Method) -> None:
    """As in a notebook: a sequence with fixes, the methods stepped by hand, and the results read."""
    assert pairs.truth is not None
    rng, truth = np.random.default_rng(1), pairs.truth
    fixes = [fix(t, pose, SIGMA_M, rng) for t, pose in truth.items()[::2]]
    antenna = GnssAntenna(rig_from_sensor=LEVER)
    rig = pairs.rig.changed(gnss=antenna)
    sequence = Sequence("with fixes", rig, pairs.times_ns, pairs.kinds, pairs.load).with_measurements(fixes)
    assert sequence.kinds.count("gnss") == len(fixes) and (np.diff(sequence.times_ns) >= 0).all()
    same = np.flatnonzero(np.diff(sequence.times_ns) == 0)
    assert len(same) and all(sequence.kinds[i] == "gnss" for i in same), "fixes come before frames of the same time"
    config = Config().with_settings("gps_stereo", example.GpsStereoConfig(start_m=0.5))
    ensemble = build(config, ("gps_stereo",), sequence.rig)
    state, steps = ensemble.start(), []
    for i in range(len(sequence)):
        state, found = ensemble.step(state, sequence[i])
        steps += found
    assert {step.method for step in steps} == {"gps_stereo"}
    assert len(steps) == len(fixes) + sequence.kinds.count("stereo")
    error = error_m(ensemble.finish(state)["gps_stereo"], truth)
    assert error < 5 * SIGMA_M, "the rig starts a few degrees from level, and the way is 2 m long"
