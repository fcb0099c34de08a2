"""Suspects among other sensors: their place in the ranking, and one examination for all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.examination import Examination
from ispom.evaluation.doctor.finding import Finding, Suspect
from ispom.evaluation.doctor.suspects.sensors import SENSORS
from ispom.types import Rig
from tests.accuracy.sensors import plants
from tests.evaluation.sensors.test_judged import scene

PLANTED = next(each for each in plants(("imu",)) if each.name == "IMU clock +100 ms")


def seen(used: frozenset[str] = frozenset({"imu"})) -> Examination:
    late = replace(PLANTED.applied(scene("sim:flight 0")), used=used)
    return Examination(Rig({}), (), np.zeros(0, np.int64), sensors=late)


def always(key: str, how: str) -> Suspect:
    return Suspect(key, key, how, "", lambda _: Finding(2.0, "It is so."))  # type: ignore[arg-type]


def test_without_sensors_nothing_is_said() -> None:
    found = diagnose(Examination(Rig({}), (), np.zeros(0, np.int64)), SENSORS)
    assert not found.ranked and set(found.silent) == {suspect.key for suspect in SENSORS}


def test_a_sensor_that_is_used_comes_before_the_images_and_another_after_them() -> None:
    suspects = (always("dark", "images"), always("off", "counterfactual"), *SENSORS)
    first = [
        [each.suspect.key for each in diagnose(seen(used), suspects).causes]
        for used in (frozenset({"imu"}), frozenset())
    ]
    assert first == [["imu-clock", "dark", "off"], ["dark", "off", "imu-clock"]]


def test_all_of_them_are_one_examination() -> None:
    asked = []

    def once(name: str) -> bool:
        asked.append(name)
        return len(asked) == 1

    found = diagnose(seen(), SENSORS, once)
    assert len(asked) == 1 and not found.left
