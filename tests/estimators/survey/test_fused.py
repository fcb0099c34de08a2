"""Images fused with other sensors: exact measurements give the exact path, and what errs is named.

Most tests give the method the poses that perfect images would have, in a unit and a world of their own.
"""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ispom.errors import InputError
from ispom.estimators.survey import fused
from ispom.estimators.survey.fused import SCHEMES, FusedConfig
from ispom.estimators.survey.fused_graph import Graph
from ispom.estimators.survey.fused_noise import grown, stated_noise
from ispom.estimators.survey.fused_stereo import FusedStereoConfig
from ispom.estimators.survey.fused_tight import FusedTightConfig
from ispom.evaluation.trajectory_error import error_against_truth
from ispom.geometry import Pose, skew
from ispom.sensors.fusion import Link, MotionNoise, Node
from ispom.sensors.gnss import SimulatedGnss
from ispom.sensors.imu import SimulatedImu, true_imu
from ispom.sensors.laser import SimulatedLaser, deskewed
from ispom.sensors.simulated import Scenery
from ispom.sensors.wheel import SimulatedWheel, wheel_link
from ispom.simulation.motions import motion_of
from ispom.simulation.places.city import build_city
from ispom.testing import check_estimator
from ispom.testing.flight import flight, flight_rig
from ispom.testing.values import digest
from ispom.types import (
    Camera,
    Frame,
    ImuSamples,
    Landmarks,
    Measurement,
    Rig,
    Sequence,
    Status,
    Step,
    Trajectory,
    WheelIncrement,
    WheelOdometer,
)

pytest.importorskip("gtsam")
UNIT = 0.4
"""Units of the images per metre."""
RIG_FROM_VIDEO = Pose.from_rotvec(np.radians([1.2, -1.7, 0.9]), np.array([0.025, -0.045, 0.03]))
EXACT = {
    "imu": SimulatedImu(rate_hz=50, noise=0, gyroscope_bias_deg_s=0, accelerometer_bias_m_s2=0),
    "gnss": SimulatedGnss(noise_m=0, stated_m=0.02, rate_hz=4),
    "wheel": SimulatedWheel(noise=0),
    "laser": SimulatedLaser(points=360, rate_hz=2.5),
}
city = cache(build_city)


def error_of(estimate: Trajectory, truth: Trajectory, rig: Rig) -> float:
    """Returns the ATE [m] after the alignment by SE(3)."""
    error = error_against_truth(estimate, truth, rig, "se3")
    assert error is not None
    return error.ate_m


class Run:
    """A run of the method over 6 s of the drive in the city, with images at 10 Hz."""

    def __init__(self, config: FusedConfig, sensors: dict[str, Any], turn: float = 0.0, place: float = 0.0) -> None:
        self.stereo = isinstance(config, FusedStereoConfig)
        times_ns = np.arange(0, 6_000_000_000, 100_000_000)
        around = Scenery(motion_of("drive", 0).pose_at, times_ns, lambda: city(0), 0)
        rig = Rig.of(video=Camera(64, 48, 50.0, 50.0, 31.5, 23.5), rig_from_video=RIG_FROM_VIDEO)
        self.rig = rig.changed(**{name: each.sensor() for name, each in sensors.items()})
        self.truth = Trajectory.of([(int(t), around.pose_at(int(t))) for t in times_ns])
        others: list[Measurement] = [m for each in sensors.values() for m in each.measured(around)]
        grey = np.zeros((48, 64), np.uint8)
        frames = [Frame.stereo(int(t), grey, grey) if self.stereo else Frame.video(int(t), grey) for t in times_ns]
        self.measurements: list[Measurement] = sorted(
            (*others, *frames), key=lambda m: (m.time_ns, isinstance(m, Frame))
        )
        self.images = self._images(turn, place)
        self.estimator: Any = config.build(self.rig)
        self.steps, self.state = self.played(self.estimator.start(), self.measurements)
        self.final = self.estimator.finish(self.state, {"visual": Trajectory.of(list(self.images.items()), "video")})

    def _images(self, turn: float, place: float) -> dict[int, Pose]:
        """Returns world_from_camera by time, whose relative poses err by these [rad], [shares]."""
        rng, true = np.random.default_rng(5), self.truth.moved(right=None if self.stereo else RIG_FROM_VIDEO)
        now, found = Pose(), dict[int, Pose]()
        for i, (time_ns, pose) in enumerate(true.items()):
            if i:
                moved = true.pose(i - 1).inverse() @ pose
                length = float(np.linalg.norm(moved.translation))
                now = (
                    now
                    @ moved
                    @ Pose.exp(np.concatenate([place * length * rng.normal(size=3), turn * rng.normal(size=3)]))
                )
            found[time_ns] = now if self.stereo else now.scaled(UNIT)
        return found

    def played(self, state: Any, measurements: list[Measurement]) -> tuple[list[Step], Any]:
        steps = list[Step]()
        for m in measurements:
            inputs = {}
            if isinstance(m, Frame):
                inputs = {"visual": Step(m.time_ns, Status.TRACKING, "video", self.images[m.time_ns])}
            state, step = self.estimator.step(state, m, inputs)
            if isinstance(m, Frame):
                steps.append(step)
        return steps, state

    @property
    def error_m(self) -> float:
        return error_of(self.final, self.truth, self.rig)

    def values(self, key: str) -> list[Any]:
        return [d for step in self.steps for d in step.decisions if d.key == key]


def chosen(scheme: str, **changed: Any) -> dict[str, Any]:
    names = [name for name in EXACT if name in SCHEMES[scheme]]
    return {name: changed.get(name, EXACT[name]) for name in names}


def config(scheme: Any, **values: Any) -> FusedConfig:
    return FusedConfig(scheme=scheme, start_m=3.0, node_s=0.4, window=6, **values)


@pytest.mark.parametrize("scheme", ["3", "4", "6", "7"])
def test_exact_measurements_give_the_exact_path(scheme: str) -> None:
    run = Run(config(scheme), chosen(scheme))
    assert run.error_m < 0.03 and len(run.final) == len(run.truth)
    assert run.steps[-1].status is Status.TRACKING
    assert [s.scale for s in run.steps if s.scale][-1] == pytest.approx(1 / UNIT, rel=0.01)
    for sensor in SCHEMES[scheme]:
        assert all(d.passed for d in run.values(f"{sensor}_misfit"))
        assert run.values(f"{sensor}_gain")[-1].value > 1


def test_a_pair_needs_no_start() -> None:
    run = Run(FusedStereoConfig(scheme="8", node_s=0.4, window=6), chosen("8"), turn=2e-4, place=2e-3)
    assert run.steps[0].status is Status.TRACKING and run.error_m < 0.05
    assert run.steps[0].scale is None and run.values("wheel_gain")[-1].value > 1


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_bias_and_gravity_are_stated_with_their_standard_deviations(noise: float) -> None:
    unit = SimulatedImu(noise=noise, gyroscope_bias_deg_s=0.5, accelerometer_bias_m_s2=0.0)
    run = Run(FusedStereoConfig(scheme="6", start_m=3.0), {"imu": unit}, turn=1e-4 * noise, place=1e-3 * noise)
    samples = [m for m in run.measurements if isinstance(m, ImuSamples)]
    times_ns = np.concatenate([m.times_ns for m in samples])
    around = motion_of("drive", 0).pose_at
    rates, _ = true_imu(around, times_ns, unit.sensor().rig_from_sensor)
    bias = (np.concatenate([m.angular_velocity_rad_s for m in samples]) - rates).mean(axis=0)
    found = [step for step in run.steps if step.key_frame][-1].calibration
    assert found.imu is not None and found.imu.covariance is not None and found.gravity is not None
    off = found.imu.values[3:] - bias
    assert np.degrees(np.linalg.norm(off)) < 0.05
    assert (abs(off) < 4 * np.sqrt(np.diag(found.imu.covariance)[3:]) + 1e-5).all()
    tilt = np.arccos(np.clip(found.gravity.direction @ [0.0, 1.0, 0.0], -1, 1))  # the drive is level
    assert tilt < 4 * np.sqrt(np.trace(found.gravity.covariance)) + 1e-4
    assert abs(found.gravity.covariance @ found.gravity.direction).max() < 1e-9


def test_the_clock_of_the_imu_is_stated_with_its_standard_deviation() -> None:
    config = FusedStereoConfig(scheme="6", start_m=3.0, node_s=0.1)
    run = Run(config, {"imu": SimulatedImu(noise=0.0, late_ms=50.0)})
    found = run.steps[-1].calibration.imu_clock
    assert found is not None and found.late_s == pytest.approx(0.05, abs=2e-3) and 0 < found.sigma_s < 0.02


def test_without_an_imu_neither_bias_nor_gravity_is_stated() -> None:
    steps = Run(FusedStereoConfig(scheme="8", start_m=3.0), chosen("8")).steps
    assert all(step.calibration.imu is None and step.calibration.gravity is None for step in steps)


def test_a_pair_has_poses_before_its_fixes_are_far_enough_apart() -> None:
    run = Run(FusedStereoConfig(scheme="4", start_m=200.0, node_s=0.4, window=6), chosen("4"))
    assert {step.status for step in run.steps} == {Status.TRACKING}
    assert len(run.final) == len(run.truth) and run.error_m < 1e-6
    aligned = run.values("gnss_aligned")[-1]
    assert not aligned.passed and 5 < aligned.value < aligned.threshold == 200


def test_a_pair_begins_a_new_segment_where_it_is_aligned_with_its_fixes() -> None:
    run = Run(FusedStereoConfig(scheme="4", start_m=3.0, node_s=0.4, window=6), chosen("4"))
    assert {step.status for step in run.steps} == {Status.TRACKING}
    (restart,) = [i for i, step in enumerate(run.steps) if step.restarted]
    east_of = SimulatedGnss().local_from_world
    for i, step in enumerate(run.steps):
        true = run.truth.pose(0).inverse() @ run.truth.pose(i) if i < restart else run.truth.pose(i)
        expected = true.translation
        if i >= restart:
            east, north, up = east_of @ expected
            expected = [east, -up, north]
        assert step.world_from_frame is not None
        assert_allclose(step.world_from_frame.translation, expected, atol=0.15 if i >= restart else 1e-9)
    assert [d.passed for d in run.values("gnss_aligned")] == [False] * (len(run.values("gnss_aligned")) - 1) + [True]


def test_fixes_turn_the_world_to_the_north() -> None:
    run = Run(config("4"), chosen("4"))
    east_of = SimulatedGnss().local_from_world
    for time_ns, pose in run.final.items()[::9]:
        true = run.truth.at(time_ns)
        assert true is not None
        east, north, up = east_of @ true.translation
        assert_allclose(pose.translation, [east, -up, north], atol=0.15)


def test_fixes_that_are_not_enough_are_named_by_a_check() -> None:
    """Good fixes that lie too near each other give no start: the check has how far apart they are."""
    run = Run(FusedConfig(scheme="4", start_m=200.0, node_s=0.4), chosen("4"))
    assert {step.status for step in run.steps} == {Status.INITIALISING}
    way = run.values("start_way")[-1]
    assert not way.passed and 5 < way.value < way.threshold == 200
    assert not run.values("start_nodes")[-1].passed
    few = run.values("start_fixes")[0]
    assert not few.passed and few.value < few.threshold


def test_images_that_restart_before_the_start_only_delay_it() -> None:
    run = Run(config("4"), chosen("4"))
    state, step = run.estimator.start(), None
    for m in run.measurements:
        inputs = {}
        if isinstance(m, Frame):
            restarted = m.time_ns == 300_000_000
            inputs = {"visual": Step(m.time_ns, Status.TRACKING, "video", run.images[m.time_ns], restarted=restarted)}
        state, step = run.estimator.step(state, m, inputs)
    assert step is not None and step.status is Status.TRACKING


def test_slip_is_recognised_and_ignored() -> None:
    wheel = SimulatedWheel(slip=0.6, slip_from_s=2, slip_until_s=4)
    run = Run(config("8"), chosen("8", wheel=wheel), turn=2e-4, place=2e-3)
    slips = [s.time_ns * 1e-9 for s in run.steps for d in s.decisions if d.key == "wheel_slip" and not d.passed]
    assert len(slips) >= 4 and min(slips) >= 2 and max(slips) <= 4.4
    assert run.error_m < 0.08


def test_an_outage_is_bridged() -> None:
    gnss = SimulatedGnss(noise_m=0.05, rate_hz=4, outage_from_s=3.2, outage_until_s=5)
    run = Run(config("2"), chosen("2", gnss=gnss), turn=2e-4, place=2e-3)
    assert run.error_m < 0.01 * run.truth.length
    spread = [np.trace(s.covariance[:3, :3]) for s in run.steps if s.covariance is not None and s.time_ns > 3.3e9]
    assert spread[0] < max(spread[:17]) and spread[-1] < max(spread[:17])


def test_a_jump_of_the_fixes_is_named() -> None:
    gnss = replace(EXACT["gnss"], jump_m=5, jump_from_s=4.4, jump_until_s=5)
    run = Run(config("2"), chosen("2", gnss=gnss))
    assert any(not d.passed for d in run.values("gnss_misfit"))
    assert run.error_m < 0.1


def test_a_noisier_sensor_contributes_less() -> None:
    gain = [
        Run(config("2"), chosen("2", gnss=SimulatedGnss(noise_m=0.0, stated_m=m, rate_hz=4)))
        .values("gnss_gain")[-1]
        .value
        for m in (0.05, 0.3)
    ]
    assert gain[0] > gain[1] > 1


def test_a_run_goes_on_from_any_state_to_the_same_end() -> None:
    once = Run(config("3"), chosen("3"), turn=2e-4, place=2e-3)
    half = len(once.measurements) // 2
    _, middle = once.played(once.estimator.start(), once.measurements[:half])
    before = digest(middle)
    assert digest(once.played(middle, once.measurements[half:])[1]) == digest(once.state)
    assert digest(middle) == before
    other: Any = config("4").build(once.rig)
    once.estimator = other
    steps, _ = once.played(middle, once.measurements[half:])
    assert steps[-1].status is Status.TRACKING


def test_a_missing_sensor_or_library_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig.single(Camera(64, 48, 50.0, 50.0, 31.5, 23.5))
    with pytest.raises(InputError, match=r"^fused needs"):
        FusedConfig().build(rig)
    with pytest.raises(InputError, match=r"scheme 3 needs .*IMU.*GNSS.*wheel"):
        FusedConfig(scheme="3").build(rig)
    monkeypatch.setattr(fused, "find_spec", lambda name: None)
    rig = rig.changed(wheel=WheelOdometer())
    with pytest.raises(InputError, match=r"^fused needs gtsam"):
        FusedConfig().build(rig)
    with pytest.raises(InputError, match=r"^fused\.tight needs gtsam"):
        FusedTightConfig().build(rig)
    assert importlib.util.find_spec("gtsam") is not None


def test_increments_are_cut_at_the_nodes() -> None:
    odometer = WheelOdometer()
    increments = [WheelIncrement(100 * (k + 1), 100 * k, 1.0, 0.1) for k in range(4)]
    found = wheel_link(increments, 50, 350, odometer, None)
    assert found is not None
    assert found[1] == pytest.approx(3.0) and found[0].relative.rotvec[2] == pytest.approx(0.3)
    assert wheel_link(increments[:2], 50, 1350, odometer, None) is None
    assert wheel_link([WheelIncrement(100, 0, 1.0)], 0, 100, odometer, None) is None


def test_a_scan_is_straightened() -> None:
    path = [(0, Pose()), (100, Pose(translation=np.array([1.0, 0, 0])))]
    wall = np.array([[5.0, 0, 0]] * 3)
    times = np.array([0, 50, 99])
    seen = wall - np.stack([times / 100, 0 * times, 0 * times], axis=1)
    assert_allclose(deskewed(seen, times, 100, path, Pose()), [[4.0, 0, 0]] * 3, atol=1e-12)


def test_what_leaves_the_window_stays_as_a_prior() -> None:
    """A chain of relative poses: the last covariance is the same for every window."""
    rng, found = np.random.default_rng(0), []
    links = [Link(Pose.exp(rng.normal(size=6) * 0.2), np.eye(6) * 0.01) for _ in range(5)]
    rig = Rig.single(Camera(64, 48, 50.0, 50.0, 31.5, 23.5))
    graph = Graph(rig, frozenset({"wheel"}), Pose(), MotionNoise(1e-3, 1e-2, 1e-3))
    for window in (2, 9):
        first = Node(0, 0)
        prior, nodes = graph.first_prior(first, np.eye(6) * 1e-4, s=0.1), (first,)
        for k, link in enumerate(links, 1):
            pose = nodes[-1].local_from_rig @ link.relative
            nodes, _ = graph.optimised((*nodes, Node(k, k * 10**8, pose, relative={"wheel": link})), prior)
            while len(nodes) > window:
                prior, nodes = graph.reduced(nodes, prior), nodes[1:]
        found.append((graph.uncertainty(nodes, prior).covariance, nodes[-1].local_from_rig.matrix))
    assert_allclose(found[0][0], found[1][0], rtol=1e-4, atol=1e-9)
    assert_allclose(found[0][1], found[1][1], atol=1e-6)


@pytest.mark.parametrize(("frame", "share"), [("video", 0.005), ("rig", 0.0)])
def test_the_noise_of_the_images_is_what_they_state(frame: str, share: float) -> None:
    """Rotations whose variances grow by so much a second, positions whose variances grow by so much a metre."""
    rig = Rig.of(video=Camera(64, 48, 50.0, 50.0, 31.5, 23.5)).changed(wheel=EXACT["wheel"].sensor())
    estimator: Any = config("8").build(rig)
    state, rates, walks = estimator.start(), 2e-4 * np.sqrt([0.5, 1.0, 1.5]), np.array([4e-3, 2e-3, 9e-3])
    for k in range(31):
        time_ns, grey, seconds, way = k * 100_000_000, np.zeros((48, 64), np.uint8), 0.1 * k, 0.3 * k
        points = Landmarks(np.arange(3), np.array([[0, 0, 7.0 + way]] * 3), np.zeros((3, 3), np.uint8))
        covariance = np.diag([*(walks**2 * way), *(rates**2 * seconds)])
        pose, scale_sigma = Pose(translation=np.array([0.0, 0.0, way])), 1e-3 * np.sqrt(seconds)
        visual = Step(time_ns, Status.TRACKING, frame, pose, covariance, landmarks=points, scale_sigma=scale_sigma)
        state, _ = estimator.step(state, Frame.video(time_ns, grey), {"visual": visual})
        assert (state.noise is None) == (k < 10), "a second passes first"
    assert_allclose([state.noise.turn, state.noise.scale_walk, state.noise.depth], [2e-4, 1e-3, 7.0])
    assert_allclose([state.noise.walk, state.noise.share], [2e-3, share])
    state, _ = estimator.step(
        state, Frame.video(10**10, grey), {"visual": replace(visual, time_ns=10**10, restarted=True)}
    )
    assert state.noise is None, "another world"


def test_images_of_a_camera_that_stands_state_no_error_of_translations() -> None:
    visual = Step(0, Status.TRACKING, "video", Pose(), np.diag([1e-4] * 3 + [4e-8] * 3))
    growth, otherwise = grown(None, visual), MotionNoise(1e-3, 0.02, 1e-3)
    growth = grown(growth, replace(visual, time_ns=4 * 10**9))
    found = stated_noise(growth, visual, otherwise)
    assert found is not None and (found.walk, found.share) == (None, 0.02)
    assert found.turn == pytest.approx(1e-4)


def test_nodes_from_before_the_images_stated_their_noise_have_it_later() -> None:
    """A pair starts at once: its first nodes are in the window still when a second has passed."""
    rig = Rig.stereo(Camera(64, 48, 50.0, 50.0, 31.5, 23.5), 0.3).changed(wheel=EXACT["wheel"].sensor())
    estimator: Any = FusedStereoConfig(scheme="8", node_s=0.4).build(rig)
    state, grey = estimator.start(), np.zeros((48, 64), np.uint8)
    for k in range(31):
        time_ns, covariance = k * 100_000_000, np.diag([1e-4] * 3 + [4e-8 * k * 0.1] * 3)
        place = Pose(translation=np.array([0.0, 0.0, 0.01 * k]))
        visual = Step(time_ns, Status.TRACKING, "rig", place, covariance)
        state, _ = estimator.step(state, Frame.stereo(time_ns, grey, grey), {"visual": visual})
    assert len(state.nodes) >= 5 and state.nodes[0].time_ns <= 400_000_000
    turns = np.array([node.noise.turn for node in state.nodes if node.visual is not None])
    assert_allclose(turns, 2e-4, rtol=1e-6)


def test_an_error_of_a_rotation_is_one_about_the_middle_of_the_scene() -> None:
    noise = MotionNoise(turn=1e-3, share=0.0, scale_walk=0.0, depth=10.0)
    spread = noise.covariance(Pose(), 2.0, 1.0)
    middle = np.hstack([np.eye(3), -skew(np.array([0.0, 0.0, 20.0]))])
    assert np.sqrt(np.diag(spread))[:3] == pytest.approx([0.02, 0.02, 0.0], abs=2e-4)
    assert np.trace(middle @ spread @ middle.T) < 1e-7, "it stays"


def test_errors_of_translations_add_up_along_the_way() -> None:
    """Two halves have the variance of the whole where the images state one, besides that of the length."""
    noise = MotionNoise(0.0, 0.0, 0.0, walk=0.01)
    whole, half = (noise.covariance(Pose(translation=np.array([0, 0, z])), 2.0, 1.0) for z in (4.0, 2.0))
    assert_allclose(whole[:3, :3], 2 * half[:3, :3], atol=1e-7)
    assert_allclose(np.sqrt(np.diag(whole)[:3]), 2.0 * 0.01 * 2.0, rtol=1e-4)
    along = replace(noise, share=0.1).covariance(Pose(translation=np.array([0, 0, 4.0])), 2.0, 1.0)
    assert_allclose((along - whole)[:3, :3], np.diag([0.0, 0.0, 0.8**2]), atol=1e-12)


def with_all_sensors() -> Sequence:
    """The frames of the contract, with all sensors along the same motion."""
    rig, frames = flight_rig(), [m for m in flight(flight_rig()) if m.kind == "video"]

    def pose_at(time_ns: int) -> Pose:
        k = time_ns / 33e6
        return Pose.from_rotvec(np.array([0.0, 0.003 * k, 0.0]), np.array([0.001 * k**2, 0.0, 0.13 * k]))

    times_ns = np.array([m.time_ns for m in frames])
    around = Scenery(pose_at, times_ns, lambda: city(0), 0)
    sensors = [SimulatedImu(), SimulatedGnss(noise_m=0.05, rate_hz=10), SimulatedWheel(), SimulatedLaser(points=90)]
    rig = rig.changed(**{each.name: each.sensor() for each in sensors})
    plain = Sequence("flight", rig, times_ns, tuple(m.kind for m in frames), frames.__getitem__)
    return plain.with_measurements([m for each in sensors for m in each.measured(around)])


@pytest.mark.slow
def test_the_contract() -> None:
    settings = FusedConfig(start_m=1.0, node_s=0.1)
    check_estimator("fused", settings=settings, sequence=with_all_sensors())


KITTI = Path(__file__).parents[4] / "shared" / "data"


@pytest.mark.slow
@pytest.mark.skipif(not (KITTI / "sensors" / "kitti_00").is_dir(), reason="../shared/data/sensors/kitti_00 is absent")
@pytest.mark.parametrize(("scheme", "most_m"), [("1", 0.2), ("4", 0.2), ("6", 0.7)])
def test_kitti_with_its_own_sensors(tmp_path: Path, scheme: Any, most_m: float) -> None:
    """GNSS alone is 0.25 m off."""
    from ispom.ensemble import build
    from ispom.methods import Config
    from ispom.sequences import open_sequence

    pose = "{translation_m: [-0.3391, 0.7468, -1.0957], rotation_xyzw: [0.506871, -0.495521, 0.500083, 0.497451]}"
    folder = KITTI / "sensors" / "kitti_00"
    (tmp_path / "sensors.yaml").write_text(
        f"""
imu:
  file: {folder / "imu.txt"}
  columns: {{time_s: Time, ax: accelX, ay: accelY, az: accelZ, gx: omegaX, gy: omegaY, gz: omegaZ}}
  clock_offset_s: -46534.998
  rig_from_imu: {pose}
gnss: {{file: {folder / "gps.txt"}, columns: {{time_s: Time, x: X, y: Y, z: Z}}, sigma_m: 0.07,
  clock_offset_s: -46534.943, rig_from_gnss: {pose}}}
"""
    )
    sequence = open_sequence(str(KITTI / "kitti" / "sequences" / "00"), sensors=tmp_path / "sensors.yaml")
    ensemble = build(Config().with_settings("fused", FusedConfig(scheme=scheme)), ("fused",), sequence.rig)
    state = ensemble.start()
    for i in range(len(sequence)):
        state, _ = ensemble.step(state, sequence[i])
    assert sequence.truth is not None
    assert error_of(ensemble.finish(state)["fused"], sequence.truth, sequence.rig) < most_m
