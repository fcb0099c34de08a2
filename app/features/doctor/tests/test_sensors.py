"""What the doctor compares other sensors with: a path by images alone, of a stored run."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.run_events.stretch import Stretch
from ispom_app.engine.run_folder.run_file import read_run_file
from ispom_app.features.doctor.command import opened
from ispom_app.features.doctor.options import Doctor
from ispom_app.features.doctor.origin import Origin
from ispom_app.features.doctor.sensors import sensor_scene

from ispom.evaluation.sensors.judged import judged
from ispom.evaluation.sensors.scene import SensorScene
from tests.app.helpers import ran


def scene_of(folder: Path, source: str, methods: str) -> SensorScene | None:
    ran(source, folder, "--methods", methods, "--no-recording")
    run = read_run_file(folder)
    sequence = opened(Doctor(run=folder), run)
    origin = Origin.of_folder(folder, run, sequence)
    return sensor_scene(origin, sequence, Stretch(0, len(sequence) - 1, 0))


@pytest.mark.slow
def test_a_late_clock_of_the_imu_is_found_in_a_run_that_uses_it(tmp_path: Path) -> None:
    scene = scene_of(tmp_path / "run", "sim:tiny?motion=drive&duration_s=12&sensor=imu:late_ms=100", "fused.stereo")
    assert scene is not None and scene.metric and "imu" in scene.used
    found = judged(scene).claims
    assert [key for key, claim in found.items() if claim.found] == ["imu-clock"]
    clock = found["imu-clock"]
    assert clock.values["late_s"] == pytest.approx(0.1, abs=4 * clock.sigma + 1e-3)


def test_without_other_sensors_nothing_is_compared(tmp_path: Path) -> None:
    assert scene_of(tmp_path / "run", "sim:tiny?duration_s=1", "stereo") is None
