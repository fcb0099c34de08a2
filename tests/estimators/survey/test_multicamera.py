"""Rigs of many cameras: exact points, what determines the scale, rings against one camera, and real rigs."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ispom.ensemble import build
from ispom.estimators.survey.multicamera import CHECKS, Memory, MulticameraConfig
from ispom.evaluation.metrics import path_errors
from ispom.geometry import Pose
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.sequences.formats.simulated import open_simulated
from ispom.sequences.images import read_grey
from ispom.solvers.generalised import scaled
from ispom.types import Camera, Frame, Image, Rig, Sequence, Status, Step, Trajectory
from tests.alone import run
from tests.crops import cropped_pair, only_cameras

KITTI = Path("../shared/data/kitti/sequences/06")
SIX = Path("../shared/data/sensors/six_cameras")
BALLS, BALL_M = 1500, 0.1
CAMERA = Camera(240, 180, 140.0, 140.0, 119.5, 89.5)


def walked(sequence: Sequence, **settings: Any) -> tuple[list[Step], Trajectory]:
    config = Config().with_settings("multicamera", MulticameraConfig(**settings))
    ensemble = build(config, ("multicamera",), sequence.rig)
    state, steps = ensemble.start(), []
    for i in range(len(sequence)):
        state, found = ensemble.step(state, sequence[i])
        steps += found
    return steps, ensemble.finish(state)["multicamera"]


def decisions(steps: list[Step], key: str) -> list[Any]:
    return [d for step in steps for d in step.decisions if d.key == key]


def figures(sequence: Sequence, metric: bool = True, **settings: Any) -> dict[str, Any]:
    _, trajectory = walked(sequence, **settings)
    assert sequence.truth is not None
    return path_errors(trajectory, sequence.truth, sequence.rig, metric)


@cache
def outwards(count: int, turning: bool, degrees: float = 5.0) -> Sequence:
    """Cameras without overlap on a circle of 0.5 m, past balls: straight ahead, or turning by so much a frame."""
    values: dict[str, Camera | Pose] = {f"c{k}": CAMERA for k in range(count)}
    for k in range(count):
        aside = Pose.from_rotvec(np.array([0.0, 2 * np.pi * k / count, 0.0]), np.zeros(3))
        values[f"rig_from_c{k}"] = aside @ Pose(translation=np.array([0.0, 0.0, 0.5]))
    rig = Rig.of(**values)
    xyz = np.random.default_rng(0).uniform((-9, -4, -8), (9, 4, 12), (BALLS, 3))
    grey = np.random.default_rng(1).integers(60, 255, BALLS)
    angle = np.radians(degrees) if turning else 0.0
    poses = [Pose.from_rotvec(np.array([0, angle * i, 0]), np.array([0.0, 0.0, 0.12 * i])) for i in range(14)]

    def load(i: int) -> Frame:
        images = {n: _image((poses[i] @ rig.rig_from(n)).inverse().apply(xyz), grey, i) for n in rig.cameras}
        return Frame(i * 100_000_000, images)

    times_ns = np.arange(len(poses)) * 100_000_000
    truth = Trajectory.of(list(zip(times_ns.tolist(), poses, strict=True)))
    return Sequence("balls", rig, times_ns, ("cameras",) * len(poses), load, truth)


def _image(xyz: np.ndarray, grey: np.ndarray, i: int) -> Image:
    image = np.full((CAMERA.height, CAMERA.width), 20, np.uint8)
    ahead = np.flatnonzero((xyz[:, 2] > 0.8) & (np.abs(xyz[:, :2]) < xyz[:, 2:]).all(axis=1))
    uv = CAMERA.project(xyz)
    for n in ahead[np.argsort(-xyz[ahead, 2])]:
        centre = (round(16 * uv[n, 0]), round(16 * uv[n, 1]))
        cv2.circle(image, centre, round(16 * CAMERA.fx * BALL_M / xyz[n, 2]), int(grey[n]), -1, cv2.LINE_AA, 4)
    return np.clip(image + np.random.default_rng(i).normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)


def test_without_overlap_the_scale_is_not_observable_on_the_straight() -> None:
    steps, trajectory = walked(outwards(3, turning=False))
    checks = decisions(steps, "relative_scale_sigma")
    assert len(checks) >= 10 and not any(check.passed for check in checks)
    assert min(check.value for check in checks) > 0.1
    assert not any(step.restarted for step in steps)
    way = trajectory.translations / np.linalg.norm(trajectory.translations[-1])
    np.testing.assert_allclose(way[-1], [0, 0, 1], atol=0.02)  # up to scale it is right
    steps_long = np.linalg.norm(np.diff(trajectory.translations, axis=0), axis=1)[1:]
    assert steps_long.std() < 0.03 * steps_long.mean()  # and the scale is held


def test_a_turning_rig_without_overlap_finds_its_scale() -> None:
    sequence = outwards(3, turning=True)
    steps, trajectory = walked(sequence)
    checks = decisions(steps, "relative_scale_sigma")
    assert sum(check.passed for check in checks) >= 6
    known = next(i for i, step in enumerate(steps) if step.restarted)  # the guess before is another segment
    assert sequence.truth is not None
    last = len(steps) - 1
    found, true = (
        t.at(int(sequence.times_ns[known])).inverse() @ t.at(int(sequence.times_ns[last]))  # type: ignore[union-attr]
        for t in (trajectory, sequence.truth)
    )
    assert np.linalg.norm(found.translation) == pytest.approx(np.linalg.norm(true.translation), rel=0.05)


def test_a_pose_is_metric_only_where_the_unit_is_known() -> None:
    """On the straight the images do not know it; of a rig that turns they do, from a later frame on."""
    straight, _ = walked(outwards(3, turning=False))
    turning, _ = walked(outwards(3, turning=True))
    known = next(i for i, step in enumerate(turning) if step.restarted)
    for step in (*straight, *turning[:known]):
        if step.world_from_frame is not None:
            assert step.provisional and step.scale_sigma is None
    limit = MulticameraConfig().max_scale_sigma
    for step in turning[known:]:
        assert not step.provisional and step.scale_sigma is not None and step.scale_sigma <= limit
    checks = decisions(turning[known - 1 :], "metre_sigma")
    assert [check.passed for check in checks] == [False] + [True] * (len(checks) - 1)


def test_a_unit_that_was_known_long_ago_is_not_the_metre_any_more() -> None:
    sequence = outwards(3, turning=True)
    estimator = MulticameraConfig().build(sequence.rig)
    state, step = estimator.start(), None
    for i in range(10):
        state, step = estimator.step(state, sequence[i])
    assert step is not None and not step.provisional and state.memory is not None
    forgotten = replace(state, memory=replace(state.memory, metre_sigma=0.2, unit_sigma=0.2))
    _, then = estimator.step(forgotten, sequence[10])
    assert then.scale_sigma is not None and step.scale_sigma is not None
    assert step.scale_sigma < then.scale_sigma < 0.2  # what the images know of it counts
    straight = outwards(3, turning=False)
    state = estimator.start()
    for i in range(8):
        state, step = estimator.step(state, straight[i])
    assert state.memory is not None
    forgotten = replace(state, memory=replace(state.memory, metre_sigma=0.2, unit_sigma=0.2, scale_known=True))
    _, then = estimator.step(forgotten, straight[8])
    assert then.provisional and then.scale_sigma == pytest.approx(0.2, abs=0.03)


@pytest.mark.slow
def test_the_stated_scale_of_a_ring_is_as_far_off_as_it_says() -> None:
    squares = []
    for seed in range(5):
        sequence = open_sequence(f"sim:ring5?duration_s=4&seed={seed}")
        assert sequence.truth is not None
        steps = [step for step in walked(sequence)[0] if step.world_from_frame is not None]
        off = []
        for first, last in zip(steps[:-6], steps[6:], strict=True):
            own = first.world_from_frame.inverse() @ last.world_from_frame  # type: ignore[union-attr]
            true = sequence.truth.at(first.time_ns).inverse() @ sequence.truth.at(last.time_ns)  # type: ignore[union-attr]
            ratio = np.linalg.norm(own.translation) / np.linalg.norm(true.translation)
            assert last.scale_sigma is not None and not last.provisional
            off.append((np.log(ratio) / last.scale_sigma) ** 2)
        squares.append(np.mean(off))
    assert 0.3 < np.mean(squares) < 2  # 1 is right


def off_by(memory: Memory, degrees: float) -> float:
    """By which factor the window is too long, of a rig that turns by so much with each 0.12 m."""
    first, last = memory.window.pose(0), memory.window.pose(-1)
    moved = first.inverse() @ last
    frames = np.degrees(np.linalg.norm(moved.log()[3:])) / degrees
    return float(np.linalg.norm(moved.translation)) / max(0.12 * frames, 1e-9)


def test_a_guess_that_the_images_contradict_is_freed() -> None:
    """The guess is 75 % too long, and held while nothing is known; the cameras know better before they know it well."""
    sequence = outwards(3, turning=True, degrees=2.0)
    estimator = MulticameraConfig().build(sequence.rig)
    state, factors, wrong = estimator.start(), [], []
    for i in range(len(sequence)):
        state, step = estimator.step(state, sequence[i])
        factors.append(off_by(state.memory, 2.0))
        wrong += [i for d in step.decisions if d.key == "scale_contradiction" and not d.passed]
        assert not wrong or i != wrong[0] or step.restarted
    assert len(wrong) == 1 and factors[wrong[0] - 1] > 1.5
    assert factors[wrong[0]] < 1.2 and factors[-1] == pytest.approx(1, abs=0.05)


def test_a_known_scale_that_the_images_contradict_is_found_anew() -> None:
    sequence = outwards(3, turning=True)
    estimator = MulticameraConfig().build(sequence.rig)
    state, contradicted = estimator.start(), []
    for i in range(len(sequence)):
        state, step = estimator.step(state, sequence[i])
        contradicted += [i for d in step.decisions if d.key == "scale_contradiction" and not d.passed]
        memory = state.memory
        if i == 9:
            assert memory.scale_known and not contradicted
            wrong = replace(memory, window=scaled(memory.window, 1.33), rho_sigma=memory.rho_sigma / 1.33)
            state = replace(state, memory=wrong)
    assert contradicted == [10]
    assert off_by(state.memory, 5.0) == pytest.approx(1, abs=0.05)


def test_one_camera_never_knows_its_scale() -> None:
    checks = decisions(walked(only_cameras(outwards(3, turning=True), ["c0"]))[0], "relative_scale_sigma")
    assert checks and not any(check.passed for check in checks)
    assert CHECKS["relative_scale_sigma"].kind == "finding"


def test_a_lost_rig_begins_again_where_it_was() -> None:
    sequence = outwards(3, turning=False)
    ensemble = build(Config(), ("multicamera",), sequence.rig)
    state, steps = ensemble.start(), []
    for i in range(14):
        frame = sequence[i]
        assert isinstance(frame, Frame)
        if i == 7:
            frame = Frame(frame.time_ns, {n: np.full_like(image, 9) for n, image in frame.images.items()})
        state, found = ensemble.step(state, frame)
        steps += found
    assert steps[6].status is Status.TRACKING and steps[7].status is Status.LOST
    assert steps[-1].status is Status.TRACKING and any(step.restarted for step in steps[8:])


def test_a_frame_may_lack_a_camera() -> None:
    sequence = outwards(3, turning=False)
    ensemble = build(Config(), ("multicamera",), sequence.rig)
    state, steps = ensemble.start(), []
    for i in range(10):
        frame = sequence[i]
        assert isinstance(frame, Frame)
        images = {n: image for n, image in frame.images.items() if n != "c1" or i not in (5, 6)}
        state, found = ensemble.step(state, Frame(frame.time_ns, images))
        steps += found
    assert all(step.status is Status.TRACKING for step in steps[4:])


@pytest.mark.slow
@pytest.mark.parametrize("count", [5, 6, 8])
def test_a_ring_is_better_than_one_of_its_cameras(count: int) -> None:
    sequence = open_simulated(f"ring{count}", duration_s=6.0)
    ring, alone = (figures(s) for s in (sequence, only_cameras(sequence, ["camera0"])))
    assert ring["t_err_percent"] < min(1.0, alone["t_err_percent"])
    assert ring["r_err_deg_per_100m"] < alone["r_err_deg_per_100m"]


@pytest.mark.slow
@pytest.mark.skipif(not KITTI.is_dir(), reason="KITTI 06 is not in ../shared/data")
def test_kitti_06_with_little_overlap() -> None:
    sequence = open_sequence(str(KITTI))
    assert figures(cropped_pair(sequence, 0.3))["t_err_percent"] < 2.0
    steps, _ = walked(cropped_pair(sequence, 0.0))
    assert not any(check.passed for check in decisions(steps, "relative_scale_sigma"))
    assert figures(cropped_pair(sequence, 0.0), metric=False)["t_err_percent"] < 2.0


def six_cameras(scale: float) -> tuple[Rig, list[tuple[Frame, Pose]]]:
    """Frames of a car with six cameras, and world_from_rig."""
    calibration = json.loads((SIX / "calibration.json").read_text())
    truth = json.loads((SIX / "truth.json").read_text())

    def pose(values: dict[str, Any]) -> Pose:
        q, t = values["rotation"], values["translation"]
        return Pose.from_xyzw(np.array([q[f"q{a}"] for a in "xyzw"]), np.array([t[a] for a in "xyz"]))

    values: dict[str, Camera | Pose] = {}
    for name, content in calibration.items():
        if name.startswith("CAMERA"):
            k = content["intrinsics"]
            values[name] = Camera(1936, 1216, k["fx"], k["fy"], k["cx"], k["cy"]).scaled(scale)
            values[f"rig_from_{name}"] = pose(content["rig_from_camera"])
    rig = Rig.of(**values)
    instants: dict[str, dict[str, Any]] = {}
    for entry in truth:
        instants.setdefault(entry["timestamp"][:19], {})[entry["camera"]] = entry
    frames = []
    for i, by_camera in enumerate(instants.values()):
        size = (rig.camera("CAMERA_01").width, rig.camera("CAMERA_01").height)
        images = {n: read_grey(SIX / e["file"]) for n, e in by_camera.items()}
        small = {
            n: np.asarray(cv2.resize(im, size, interpolation=cv2.INTER_AREA), np.uint8) for n, im in images.items()
        }
        world_from_rig = pose(by_camera["CAMERA_01"]["world_from_camera"]) @ rig.rig_from("CAMERA_01").inverse()
        frames.append((Frame(i * 10**9, small), world_from_rig))
    return rig, frames


@pytest.mark.slow
@pytest.mark.skipif(not SIX.is_dir(), reason="six_cameras is not in ../shared/data/sensors")
def test_six_real_cameras() -> None:
    rig, frames = six_cameras(0.5)
    assert len(frames) == 3 and all(len(frame.images) == 6 for frame, _ in frames)
    estimator = MulticameraConfig(max_points=1200).build(rig)
    steps = list(run(estimator, (frame for frame, _ in frames)))
    assert all(step.status is Status.TRACKING for step in steps)
    assert all(check.passed for check in decisions(steps, "relative_scale_sigma"))  # by what two cameras see
    found, true = steps[2].world_from_frame, frames[0][1].inverse() @ frames[2][1]
    assert found is not None
    assert np.linalg.norm(found.translation - true.translation) < 0.05 * np.linalg.norm(true.translation)
    assert np.degrees(np.linalg.norm((true.inverse() @ found).rotvec)) < 0.3
