"""Simulated sensors: without errors they give the true motion, and each error is what its setting says."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from ispom.errors import InputError
from ispom.geometry import Pose, so3_exp
from ispom.sensors.gnss import SimulatedGnss
from ispom.sensors.imu import GRAVITY_M_S2, SimulatedImu
from ispom.sensors.laser import SimulatedLaser
from ispom.sensors.simulated import Scenery
from ispom.sensors.wheel import SimulatedWheel
from ispom.sequences.formats.simulated import open_scenario
from ispom.simulation.motions import motion_of
from ispom.simulation.places.city import build_city
from ispom.simulation.scenario.scenario import scenario_of_file, scenario_of_words, simulated_sensors
from ispom.testing.values import digest
from ispom.types import Measurement

EXACT_IMU = SimulatedImu(noise=0, gyroscope_bias_deg_s=0, accelerometer_bias_m_s2=0)


city = cache(build_city)


def scenery(motion: str = "drive", seed: int = 0, seconds: float = 4.0) -> Scenery:
    frames_ns = np.arange(0, round(seconds * 1e9), 33_333_333)
    return Scenery(motion_of(motion, seed).pose_at, frames_ns, lambda: city(seed), seed)


def measured(sensor: Any, around: Scenery) -> list[Any]:
    found: list[Measurement] = list(sensor.measured(around))
    assert found and (np.diff([m.time_ns for m in found]) >= 0).all()
    return found


@pytest.mark.parametrize("motion", ["flight", "drive"])
def test_an_imu_without_errors_integrates_to_the_true_motion(motion: str) -> None:
    around, unit = scenery(motion), EXACT_IMU.sensor().rig_from_sensor
    batches = measured(EXACT_IMU, around)
    times_ns = np.concatenate([b.times_ns for b in batches])
    rates = np.concatenate([b.angular_velocity_rad_s for b in batches])
    forces = np.concatenate([b.specific_force_m_s2 for b in batches])
    at = lambda t: around.pose_at(t) @ unit  # noqa: E731
    pose, velocity = at(0), (at(1_000_000).translation - at(-1_000_000).translation) / 2e-3
    for k, dt in enumerate(np.diff(times_ns) * 1e-9):
        rate, force = 0.5 * (rates[k] + rates[k + 1]), 0.5 * (forces[k] + forces[k + 1])
        middle = pose.rotation @ so3_exp(0.5 * dt * rate)
        acceleration = middle @ force + [0, GRAVITY_M_S2, 0]
        place = pose.translation + velocity * dt + 0.5 * dt**2 * acceleration
        pose, velocity = Pose(pose.rotation @ so3_exp(dt * rate), place), velocity + dt * acceleration
    error = (pose.inverse() @ at(int(times_ns[-1]))).log()
    assert np.linalg.norm(error[:3]) < 0.01 and np.degrees(np.linalg.norm(error[3:])) < 0.05


def test_the_noise_and_bias_of_an_imu_are_as_stated() -> None:
    around, unit = scenery("still", seconds=6), SimulatedImu().sensor()
    noisy = np.concatenate([m.angular_velocity_rad_s for m in measured(SimulatedImu(), around)])
    assert np.linalg.norm(noisy.mean(axis=0)) == pytest.approx(np.radians(0.2), rel=0.15)
    assert noisy.std(axis=0) == pytest.approx(unit.gyroscope_noise * 10, rel=0.15)
    forces = np.concatenate([m.specific_force_m_s2 for m in measured(SimulatedImu(), around)])
    assert forces.std(axis=0) == pytest.approx(unit.accelerometer_noise * 10, rel=0.15)
    assert np.linalg.norm(forces.mean(axis=0)) == pytest.approx(9.81, abs=0.06)


def test_fixes_are_the_antenna_in_a_turned_frame_and_the_noise_is_stated() -> None:
    around, exact = scenery(), SimulatedGnss(noise_m=0, heading_deg=90)
    first = measured(exact, around)[0]
    antenna = around.pose_at(0).apply(exact.sensor().rig_from_sensor.translation)
    np.testing.assert_allclose(first.xyz_in_local, [antenna[2], -antenna[0], -antenna[1]], atol=1e-12)
    longer = scenery(seconds=200)
    errors = [
        a.xyz_in_local - b.xyz_in_local
        for a, b in zip(
            measured(SimulatedGnss(noise_m=2, heading_deg=90), longer), measured(exact, longer), strict=True
        )
    ]
    assert np.std(errors, axis=0) == pytest.approx([2, 2, 4], rel=0.15)
    jump = measured(SimulatedGnss(noise_m=0, jump_m=9, jump_from_s=1, jump_until_s=2), around)
    moved = np.array([m.xyz_in_local for m in jump]) - [
        m.xyz_in_local for m in measured(SimulatedGnss(noise_m=0), around)
    ]
    assert moved[:, 0].tolist() == [9 if 1 <= t < 2 else 0 for t in np.arange(len(moved)) / 2]
    wrong = SimulatedGnss(wrong_arm_m=0.4).sensor().rig_from_sensor.translation
    np.testing.assert_allclose(wrong - SimulatedGnss().sensor().rig_from_sensor.translation, [0.4, 0, 0])


def test_wheels_without_errors_give_the_true_path_and_slip_is_a_share() -> None:
    around, exact = scenery(), SimulatedWheel(noise=0)
    pose = start = around.pose_at(0) @ exact.sensor().rig_from_sensor
    for m in measured(exact, around):
        half = Pose.from_rotvec(np.array([0, 0, 0.5 * m.turned_rad]), np.zeros(3))
        pose = pose @ half @ Pose(translation=np.array([m.distance_m, 0, 0])) @ half
    last = around.pose_at(m.time_ns) @ exact.sensor().rig_from_sensor
    np.testing.assert_allclose(pose.translation, last.translation, atol=2e-3)
    assert np.linalg.norm((start.inverse() @ last).translation) > 5
    plain = np.array([m.distance_m for m in measured(exact, around)])
    slipping = np.array([m.distance_m for m in measured(SimulatedWheel(noise=0, slip=0.5, slip_from_s=2), around)])
    np.testing.assert_allclose(slipping / plain, np.where(np.arange(len(plain)) / 20 >= 2, 1.5, 1.0))
    assert measured(SimulatedWheel(pair=False), around)[0].turned_rad is None


def test_a_scan_sees_the_walls_of_the_street() -> None:
    around, laser = scenery(seconds=1), SimulatedLaser(noise_m=0)
    scans = measured(laser, around)
    assert len(scans) == 4
    clouds = []
    for scan in scans:
        assert len(scan.points) > 100 and np.abs(scan.points.xyz_in_laser[:, 2]).max() < 1e-9
        poses = [around.pose_at(int(t)) @ laser.sensor().rig_from_sensor for t in scan.points.times_ns]
        clouds.append([pose.apply(p) for pose, p in zip(poses, scan.points.xyz_in_laser, strict=True)])
    apart = cKDTree(clouds[0]).query(clouds[-1])[0]
    assert np.median(apart) < 0.1, "walls stay where they are, though 0.9 m lie between the scans"


@pytest.mark.parametrize("name", simulated_sensors())
def test_there_is_nothing_in_an_outage_and_stamps_are_late(name: str) -> None:
    around = scenery()
    plain = measured(simulated_sensors()[name](), around)
    gap = measured(simulated_sensors()[name](outage_from_s=1, outage_until_s=2.5), around)
    assert 0 < len(gap) < len(plain)
    assert not [m for m in gap if 1e9 <= m.time_ns < 2.5e9 and m.kind != "laser"]
    late = measured(simulated_sensors()[name](late_ms=7), around)
    if name != "imu":  # its samples are put together from one frame to the next
        assert [m.time_ns - 7_000_000 for m in late] == [m.time_ns for m in plain]


@pytest.mark.parametrize("name", simulated_sensors())
def test_the_seed_gives_the_errors(name: str) -> None:
    around = scenery(seconds=1)
    once, again = (digest(tuple(measured(simulated_sensors()[name](), around))) for _ in "ab")
    assert once == again
    other = Scenery(around.pose_at, around.frames_ns, around.scene, 1)
    assert once != digest(tuple(measured(simulated_sensors()[name](), other)))


def test_a_source_has_them_in_its_stream_and_rig(tmp_path: Path) -> None:
    words = "tiny?motion=drive&duration_s=0.5&sensor=imu&sensor=gnss:noise_m=1,rate_hz=8&sensor=wheel&sensor=laser"
    found = open_scenario(scenario_of_words(words), 3, tmp_path)
    assert all(found.rig.has(kind) for kind in ("video", "stereo", "imu", "gnss", "wheel", "laser"))
    assert found.kinds.count("gnss") == 5 and found.kinds.count("wheel") == 10 and "imu" in found.kinds
    assert (np.diff(found.times_ns) >= 0).all() and found.name.endswith(
        "imu, gnss rate_hz 8.0, noise_m 1.0, wheel, laser"
    )
    text = (
        "scene: tiny\nmotion: drive\nduration_s: 0.5\nsensors: [imu, {gnss: {noise_m: 1, rate_hz: 8}}, wheel, laser]\n"
    )
    (tmp_path / "own.yaml").write_text(text)
    assert scenario_of_file(tmp_path / "own.yaml") == scenario_of_words(words)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("tiny?sensor=sonar", "'sonar' is no sensor: choose from imu, gnss, wheel, laser"),
        ("tiny?sensor=gnss:noise_m=-1", "gnss: noise_m is -1, give a value from 0 to 100"),
        ("tiny?sensor=gnss&sensor=gnss", "a sensor is there twice"),
    ],
)
def test_what_is_wrong_is_one_sentence(words: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        scenario_of_words(words)
