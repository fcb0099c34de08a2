"""What is claimed of sensors, on simulated motions: exact ones first, then with the errors of sensors and odometry.

What is planted is named alone, or said not to show; sensors as they are raise no alarm.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ispom.evaluation.sensors.judged import SensorsJudged, judged
from ispom.evaluation.sensors.scene import SensorScene
from ispom.geometry import so3_exp
from ispom.sensors.kind import Readings
from ispom.sequences import open_sequence
from ispom.types import Imu, Rig, Trajectory
from tests.accuracy.sensors import SIMULATED, plants, scene_of, simulated

NOWHERE = Path()
EXACT = {
    "flight": "sim:tiny?duration_s=20&sensor=imu:noise=0,gyroscope_bias_deg_s=0,accelerometer_bias_m_s2=0",
    "drive": "sim:tiny?motion=drive&duration_s=20&sensor=wheel:noise=0&sensor=gnss:noise_m=0",
}


@cache
def scene(name: str) -> SensorScene:
    return scene_of(name, NOWHERE)


@cache
def as_they_are(name: str) -> SensorsJudged:
    return judged(scene(name))


def named(found: SensorsJudged) -> set[str]:
    return {each.key for each in found.claims.values() if each.found}


def test_an_exact_imu_has_no_error() -> None:
    found = judged(simulated(open_sequence(EXACT["flight"]), 0, exact=True))
    values = {key: claim.values for key, claim in found.claims.items()}
    assert abs(values["imu-clock"]["late_s"]) < 5e-4
    assert values["imu-mount"]["mount_deg"] < 0.05
    assert values["gyroscope-bias"]["bias_deg_s"] < 0.02
    # The shake of 4 Hz, sampled at 100 Hz, loses (2 pi 4 / 100)^2 / 12 = 0.5 % between samples.
    assert values["gyroscope-unit"]["factor"] == pytest.approx(1, abs=6e-3)
    assert found.gravity is not None
    assert not named(found)


def test_exact_wheels_and_fixes_have_no_error() -> None:
    found = judged(simulated(open_sequence(EXACT["drive"]), 0, exact=True))
    values = {key: claim.values for key, claim in found.claims.items()}
    assert abs(values["wheel-clock"]["late_s"]) < 5e-3 and abs(values["gnss-clock"]["late_s"]) < 5e-3
    assert values["wheel-unit"]["factor"] == pytest.approx(1, abs=2e-3)
    assert values["gnss-unit"]["factor"] == pytest.approx(1, abs=2e-3)
    assert not named(found)


SEEDS = [pytest.param(seed, marks=[pytest.mark.slow] if seed else []) for seed in range(5)]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("motion", SIMULATED)
def test_sensors_as_they_are_raise_no_alarm(motion: str, seed: int) -> None:
    assert not named(as_they_are(f"sim:{motion} {seed}"))


PLANTS = [
    pytest.param(name, plant, id=f"{name}: {plant.name}")
    for name, kinds in (("sim:flight 0", ("imu",)), ("sim:drive 0", ("imu", "gnss", "wheel")))
    for plant in plants(kinds)
]


@pytest.mark.parametrize(("name", "plant"), PLANTS)
def test_what_is_planted_is_named_alone_or_cannot_be_told(name: str, plant) -> None:  # type: ignore[no-untyped-def]
    found = judged(plant.applied(scene(name)))
    if named(found):
        assert named(found) == {plant.key}
    else:
        assert plant.hidden_in(found)


MUST = {
    "sim:flight 0": ("IMU clock +20 ms", "IMU mount 5 deg, x", "IMU mount 90 deg, z", "gyroscope in deg/s"),
    "sim:drive 0": ("IMU clock +100 ms", "accelerometer in g", "GNSS in feet", "wheels in km/h", "wheel mount 5 deg"),
}


@pytest.mark.parametrize(("name", "plant"), [(name, plant) for name in MUST for plant in MUST[name]])
def test_what_shows_is_named(name: str, plant: str) -> None:
    chosen = next(each for each in plants(("imu", "gnss", "wheel")) if each.name == plant)
    assert named(judged(chosen.applied(scene(name)))) == {chosen.key}


def test_clock_and_bias_are_within_their_standard_deviations() -> None:
    late = judged(simulated(open_sequence(f"{SIMULATED['flight']}&seed=3".replace("imu&", "imu:late_ms=37&")), 3))
    clock = late.claims["imu-clock"]
    assert clock.values["late_s"] == pytest.approx(0.037, abs=2e-3)
    assert abs(clock.values["late_s"] - 0.037) < 4 * clock.sigma
    assert late.claims["gyroscope-bias"].values["bias_deg_s"] == pytest.approx(0.2, abs=0.05)


def test_a_rig_that_only_moves_straight_on_shows_neither_clock_nor_mount() -> None:
    rng = np.random.default_rng(1)
    times = np.arange(2000, dtype=np.int64) * 10_000_000
    path = np.stack([np.zeros(200), np.zeros(200), np.arange(200) * 0.1], axis=1)
    turns = so3_exp(2e-4 * rng.normal(size=(200, 3)))
    forces = np.array([0.0, -9.81, 0.0]) + 0.1 * rng.normal(size=(2000, 3))
    readings = Readings("imu", times, {"rates": 0.01 * rng.normal(size=(2000, 3)), "forces": forces})
    straight = Trajectory(times[::10], turns, path + 2e-3 * rng.normal(size=(200, 3)))
    found = judged(SensorScene.of(Rig({"imu": Imu()}), straight, {"imu": readings}, True))
    assert not named(found) and "imu-clock" not in found.claims
    assert found.claims["imu-mount"].shows_from > np.radians(5)


def test_too_few_poses_claim_nothing() -> None:
    whole = scene("sim:flight 0")
    short = Trajectory.of([], "rig")
    assert not judged(SensorScene.of(whole.rig, short, whole.readings, True)).claims
