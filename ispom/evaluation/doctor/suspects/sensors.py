"""Suspects among the other sensors: IMU, GNSS and wheels, by the path of the images (`ispom.evaluation.sensors`)."""

from __future__ import annotations

from functools import partial

from ..examination import Examination
from ..finding import Finding, Suspect

CLOCK = (
    "Correct `clock_offset_s` of the sensor in sensors.yaml by the stated time, or its time stamps where they are made."
)
MOUNT = "Correct the sensor's pose in the rig (`rig_from_...` in sensors.yaml or rig.yaml) by the stated rotation."
UNDECIDED = "More of the motion that shows it would decide it: turns about several axes, and changes of the speed."


def claimed(key: str, seen: Examination) -> Finding | None:
    """Returns the claim as a finding; None where the sensor is missing, or the motion does not determine it."""
    claim = seen.judged.claims.get(key)
    if claim is None or seen.sensors is None:
        return None
    values = {**claim.values, "used": float(key in used_keys(seen.sensors.used))}
    undecided = claim.rival or (UNDECIDED if claim.undecided else "")
    return Finding(claim.strength, claim.evidence, values, undecided=undecided)


def used_keys(kinds: frozenset[str]) -> frozenset[str]:
    """Returns the keys of suspects among sensors of these kinds."""
    begins = {"gyroscope": "imu", "accelerometer": "imu"}
    return frozenset(s.key for s in SENSORS if begins.get(word := s.key.split("-")[0], word) in kinds)


def _suspect(key: str, name: str, remedy: str) -> Suspect:
    return Suspect(key, name, "sensors", remedy, partial(claimed, key))


SENSORS = (
    _suspect("imu-clock", "the clock of the IMU differs from that of the images", CLOCK),
    _suspect("imu-mount", "the orientation of the IMU on the rig is wrong", MOUNT),
    _suspect(
        "gyroscope-unit",
        "the unit of the gyroscope is wrong",
        "Give rates in rad/s: multiply degrees per second by pi / 180.",
    ),
    _suspect(
        "gyroscope-bias",
        "the gyroscope has a bias that no calibrated unit has",
        "Subtract the stated bias from the rates, or calibrate the gyroscope at rest.",
    ),
    _suspect(
        "accelerometer-unit",
        "the unit or the sign of the accelerometer is wrong",
        "Give specific forces in m/s^2, which point up at rest: multiply g by 9.81, and reverse what points down.",
    ),
    _suspect(
        "accelerometer-bias",
        "the accelerometer has a bias that no calibrated unit has",
        "Subtract the stated bias from the forces, or calibrate the accelerometer in six positions.",
    ),
    _suspect("gnss-clock", "the clock of the GNSS receiver differs from that of the images", CLOCK),
    _suspect(
        "gnss-mount",
        "the place of the GNSS antenna on the rig is wrong",
        "Measure the antenna's place again (`rig_from_gnss` in sensors.yaml or rig.yaml).",
    ),
    _suspect(
        "gnss-axes",
        "the axes of the GNSS fixes are exchanged",
        "Name the columns of east, north and up (or latitude and longitude) again in sensors.yaml.",
    ),
    _suspect(
        "gnss-unit",
        "the unit of the GNSS fixes is wrong",
        "Give metres; where wheels say the same, correct the baseline of the pair.",
    ),
    _suspect("wheel-clock", "the clock of the wheels differs from that of the images", CLOCK),
    _suspect(
        "wheel-mount",
        "the place of the wheels on the rig, or their direction, is wrong",
        "Correct `rig_from_wheel`: x is the direction in which they roll, and its origin where they touch the ground.",
    ),
    _suspect(
        "wheel-unit",
        "the unit of the wheels, or their size, is wrong",
        "Give metres and radians since the row before; measure the wheels' size and their distance again.",
    ),
)
