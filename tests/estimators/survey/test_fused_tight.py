"""Images, IMU and GNSS by the points of the images: exact points and samples give the exact path.

The tests give the method the tracks that a perfect visual method would have, with or without poses.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.estimators.survey.fused_points import Sights
from ispom.estimators.survey.fused_tight import FusedTightConfig
from ispom.evaluation.trajectory_error import error_against_truth
from ispom.geometry import Pose
from ispom.sensors.fusion import Node, Points
from ispom.sensors.gnss import SimulatedGnss
from ispom.sensors.imu import SimulatedImu
from ispom.sensors.simulated import Scenery
from ispom.simulation.motions import motion_of
from ispom.simulation.places.city import build_city
from ispom.testing import check_estimator
from ispom.testing.values import digest
from ispom.types import Camera, Frame, Measurement, Rig, Status, Step, Tracks, Trajectory
from tests.estimators.survey.test_fused import with_all_sensors

pytest.importorskip("gtsam")
CAMERA = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
RIG_FROM_VIDEO = Pose.from_rotvec(np.radians([1.2, -1.7, 0.9]), np.array([0.025, -0.045, 0.03]))
IMU = SimulatedImu(rate_hz=50, noise=0, gyroscope_bias_deg_s=0, accelerometer_bias_m_s2=0)
GNSS = SimulatedGnss(noise_m=0, stated_m=0.02, rate_hz=4)
UNIT = 0.4
"""Units of the images per metre."""


def drive(time_ns: int) -> Pose:
    return motion_of("drive", 0).pose_at(time_ns)


def departure(time_ns: int) -> Pose:
    """Stands for 1.5 s, then sways."""
    t = max(0.0, time_ns * 1e-9 - 1.5)
    sway = 1 - np.cos(2.0 * t)
    return Pose.from_rotvec(np.array([0.02, 0.1, 0.0]) * sway, np.array([0.4 * sway, 0.1 * sway, 0.1 * t**3 / (1 + t)]))


@cache
def landmarks() -> np.ndarray:
    """Returns points (N, 3) around the paths."""
    return np.random.default_rng(3).uniform([-25, -4, -5], [25, 3, 60], (200, 3))


class Run:
    """A run over 5 s, with images at 10 Hz."""

    def __init__(
        self, config: FusedTightConfig, path: Any, poses: bool, noise_px: float = 0.0, seed: int = 0, **sensors: Any
    ) -> None:
        times_ns = np.arange(0, 5_000_000_000, 100_000_000)
        around = Scenery(path, times_ns, lambda: build_city(0), seed)
        self.rig = Rig.of(video=CAMERA, rig_from_video=RIG_FROM_VIDEO)
        self.rig = self.rig.changed(**{name: each.sensor() for name, each in sensors.items()})
        self.truth = Trajectory.of([(int(t), path(int(t))) for t in times_ns])
        others: list[Measurement] = [m for each in sensors.values() for m in each.measured(around)]
        black = np.zeros((480, 640), np.uint8)
        frames = [Frame.video(int(t), black) for t in times_ns]
        self.measurements = sorted((*others, *frames), key=lambda m: (m.time_ns, isinstance(m, Frame)))
        self.visual, found = dict[int, Step](), list[tuple[int, Pose]]()
        rng, start = np.random.default_rng(seed), path(0) @ RIG_FROM_VIDEO
        for time_ns in times_ns.tolist():
            camera = path(time_ns) @ RIG_FROM_VIDEO
            seen = camera.inverse().apply(landmarks())
            uv = CAMERA.project(seen)
            inside = (seen[:, 2] > 1) & (uv > 0).all(axis=1) & (uv < [640, 480]).all(axis=1)
            ids = np.flatnonzero(inside)
            tracks = Tracks.of(ids, uv[ids] + noise_px * rng.normal(size=(len(ids), 2)))
            pose = (start.inverse() @ camera).scaled(UNIT) if poses else None
            status = Status.TRACKING if poses else Status.INITIALISING
            self.visual[time_ns] = Step(time_ns, status, "video", pose, tracks={"video": tracks})
            if pose is not None:
                found.append((time_ns, pose))
        self.estimator = config.build(self.rig)
        self.steps, self.state = self.played(self.estimator.start(), self.measurements)
        self.final = self.estimator.finish(self.state, {"visual": Trajectory.of(found, "video")})

    def played(self, state: Any, measurements: list[Measurement]) -> tuple[list[Step], Any]:
        steps = list[Step]()
        for m in measurements:
            inputs = {"visual": self.visual[m.time_ns]} if isinstance(m, Frame) else {}
            state, step = self.estimator.step(state, m, inputs)
            if inputs:
                steps.append(step)
        return steps, state

    @property
    def error_m(self) -> float:
        error = error_against_truth(self.final, self.truth, self.rig, "se3")
        assert error is not None
        return error.ate_m


def config(scheme: Any, **values: Any) -> FusedTightConfig:
    return FusedTightConfig(scheme=scheme, **{"start_m": 3.0, "node_s": 0.3, "window": 6, **values})


@pytest.mark.parametrize(
    ("scheme", "sensors"),
    [
        pytest.param("2", {"imu": IMU, "gnss": GNSS}, marks=pytest.mark.slow),
        ("4", {"gnss": GNSS}),
        pytest.param("6", {"imu": IMU}, marks=pytest.mark.slow),
    ],
)
def test_exact_points_give_the_exact_path(scheme: str, sensors: dict[str, Any]) -> None:
    run = Run(config(scheme), drive, True, **sensors)
    assert run.steps[-1].status is Status.TRACKING
    assert run.error_m < 0.05
    keys = {d.key: d for step in run.steps for d in step.decisions}
    for sensor in sensors:
        assert keys[f"{sensor}_misfit"].passed and keys[f"{sensor}_gain"].value > 1
    assert keys["visual_misfit"].passed


def test_a_rig_that_stands_needs_no_map() -> None:
    """The visual method never has a pose: the IMU gives the scale, the points hold it."""
    run = Run(config("6", noise_px=0.3), departure, False, noise_px=0.3, imu=IMU)
    assert run.steps[-1].status is Status.TRACKING and len(run.final) > 35
    assert run.error_m < 0.02
    assert run.final.length == pytest.approx(run.truth.length, rel=0.03)


@pytest.mark.slow
def test_a_run_goes_on_from_any_state_to_the_same_end() -> None:
    once = Run(config("2", node_s=0.5, window=4), drive, True, imu=IMU, gnss=GNSS)
    half = len(once.measurements) // 2
    _, middle = once.played(once.estimator.start(), once.measurements[:half])
    before = digest(middle)
    assert digest(once.played(middle, once.measurements[half:])[1]) == digest(once.state)
    assert digest(middle) == before
    once.estimator = config("6").build(once.rig)
    steps, _ = once.played(middle, once.measurements[half:])
    assert steps[-1].status is Status.TRACKING


def test_a_missing_sensor_is_one_sentence() -> None:
    with pytest.raises(InputError, match="scheme 6 needs an IMU"):
        FusedTightConfig(scheme="6").build(Rig.single(CAMERA))
    with pytest.raises(InputError, match="IMU or a GNSS"):
        FusedTightConfig().build(Rig.single(CAMERA))


def seen_by(poses: list[Pose], points: np.ndarray) -> tuple[Node, ...]:
    found = list[Node]()
    for k, pose in enumerate(poses):
        at = pose.inverse().apply(points)
        found.append(Node(k, k, points=Points(np.arange(len(points)), (at[:, :2] / at[:, 2:]).astype(np.float32))))
    return tuple(found)


def arrays(poses: list[Pose]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])


def test_derivatives_of_points_are_those_of_differences() -> None:
    rng = np.random.default_rng(0)
    poses = [Pose.exp(np.concatenate([[0.2 * k, 0, 0.05 * k], 0.02 * rng.normal(size=3)])) for k in range(5)]
    points = rng.uniform([-3, -2, 4], [3, 2, 10], (20, 3))
    sights = Sights(seen_by(poses, points), 1e-3)
    placed = sights.placed(*arrays(poses), sights.start, 10)
    np.testing.assert_allclose(1 / placed[:, 2], poses[0].inverse().apply(points)[:, 2], rtol=1e-3)
    linear, small = sights.linear(*arrays(poses), placed), 1e-6
    for axis in range(6):
        twist = small * np.eye(6)[axis]
        for node, given, rows in ((3, linear.by_view, sights.view == 3), (0, linear.by_anchor, sights.view != 0)):
            changed = list(poses)
            changed[node] = poses[node] @ Pose.exp(np.concatenate([twist[3:], twist[:3]]))
            other = sights.linear(*arrays(changed), placed).residuals
            np.testing.assert_allclose((other - linear.residuals)[rows] / small, given[rows, :, axis], atol=0.02)


EUROC = Path(__file__).parents[4] / "shared" / "data" / "sensors" / "euroc_v1_01_features"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_contract() -> None:
    settings = FusedTightConfig(start_m=1.0, node_s=0.2, window=4)
    check_estimator("fused.tight", settings=settings, sequence=with_all_sensors())


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.skipif(not EUROC.is_dir(), reason="../shared/data/sensors/euroc_v1_01_features is absent")
def test_tracked_points_and_imu_of_euroc() -> None:
    from ispom.ensemble import build
    from ispom.methods import Config
    from ispom.sequences import open_sequence

    sequence = open_sequence(str(EUROC))
    ensemble = build(Config(), ("fused.tight",), sequence.rig)
    state = ensemble.start()
    for i in range(len(sequence)):
        state, _ = ensemble.step(state, sequence[i])
    final = ensemble.finish(state)["fused.tight"]
    assert sequence.truth is not None
    error = error_against_truth(final, sequence.truth, sequence.rig, "se3")
    assert error is not None and error.ate_m < 0.03
