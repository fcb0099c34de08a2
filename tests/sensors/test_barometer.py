"""A barometer: its one file is all that `fused`, files, simulations and the time axis need."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ispom
from ispom.geometry import Pose
from ispom.io.rig import read_rig, rig_text
from ispom.methods import method
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.barometer import KIND, OFFSET, Barometer, BarometerKind, Height, SimulatedBarometer
from ispom.sensors.fusion import CAUCHY, POSE, GraphFrames, Node
from ispom.sensors.simulated import Scenery
from ispom.sequences.sensors_yaml import with_sensors
from ispom.simulation.motions import motion_of
from ispom.simulation.scenario.scenario import scenario_of_words
from tests import doubles
from tests.estimators.survey import test_fused as of_fused
from tests.estimators.survey import test_fused_tight as of_tight

EXACT = SimulatedBarometer(noise_m=0, drift_m=0)


def measured(sensor: SimulatedBarometer, seconds: float = 40.0) -> tuple[np.ndarray, np.ndarray]:
    """Returns the errors (N,) of heights, and their times (N,) [ns]."""
    around = Scenery(motion_of("flight", 0).pose_at, np.array([0, round(1e9 * seconds)]), lambda: None, 3)  # type: ignore[arg-type, return-value]
    found: list[Any] = list(sensor.measured(around))
    true = [sensor.level_m - around.pose_at(m.time_ns).translation[1] for m in found]
    return np.array([m.height_m for m in found]) - true, np.array([m.time_ns for m in found])


def test_it_is_simulated_along_the_true_path() -> None:
    assert np.abs(measured(EXACT)[0]).max() < 1e-9
    noise = measured(replace(EXACT, noise_m=0.2))[0]
    assert noise.std() == pytest.approx(0.2, rel=0.15)
    drift = measured(replace(EXACT, drift_m=0.1))[0]
    assert np.diff(drift).std() == pytest.approx(0.1 / np.sqrt(EXACT.rate_hz), rel=0.15)
    times_ns = measured(replace(EXACT, outage_from_s=1, outage_until_s=3))[1]
    assert np.diff(times_ns).max() == pytest.approx(2e9, abs=2e8)
    (sensor,) = scenario_of_words("city?sensor=barometer:noise_m=0.5").sensors
    assert sensor == SimulatedBarometer(noise_m=0.5)


def test_it_is_read_from_a_table_and_from_a_rig(tmp_path: Path) -> None:
    plain = doubles.sequence()
    rows = "\n".join(f"{k / 10},{101_325 - 12 * k}" for k in range(6))
    (tmp_path / "air.csv").write_text(f"time_s,p\n{rows}\n")
    pose = "{translation_m: [0, -1, 0], rotation_xyzw: [0, 0, 0, 1]}"
    entry = f"{{file: air.csv, columns: {{pressure_pa: p}}, rig_from_barometer: {pose}, drift_m: 0.1}}"
    (tmp_path / "sensors.yaml").write_text(f"barometer: {entry}\n")
    found = with_sensors(plain, tmp_path / "sensors.yaml")
    heights = [m.height_m for m in (found[i] for i in range(len(found))) if isinstance(m, Height)]
    assert len(heights) == found.kinds.count("barometer") >= 3
    np.testing.assert_allclose(heights, np.arange(len(heights)), atol=0.01)  # 12 Pa are a metre
    (tmp_path / "rig.yaml").write_text(rig_text(found.rig))
    again = read_rig(tmp_path / "rig.yaml").sensors["barometer"]
    assert isinstance(again, Barometer) and again.drift_m == 0.1
    assert again.rig_from_sensor.translation.tolist() == [0, -1, 0]


def test_a_column_of_heights_is_the_measurement(tmp_path: Path) -> None:
    (tmp_path / "air.csv").write_text("time_s height_m\n0.1 5.5\n0.2 6.5\n")
    (tmp_path / "sensors.yaml").write_text(
        "barometer: {file: air.csv, rig_from_barometer: {translation_m: [0, 0, 0], rotation_xyzw: [0, 0, 0, 1]}}"
    )
    found = with_sensors(doubles.sequence(), tmp_path / "sensors.yaml")
    assert [m.height_m for m in (found[i] for i in range(len(found))) if isinstance(m, Height)] == [5.5, 6.5]


def test_derivatives_are_those_of_differences() -> None:
    gtsam = pytest.importorskip("gtsam")
    pose = Pose.exp(np.array([1.0, 2.0, 3.0, 0.3, -0.2, 0.5]))
    barometer = Barometer(rig_from_sensor=Pose(translation=np.array([0.4, -0.3, 0.2])))
    frames = GraphFrames(ispom.Rig.of(air=barometer), Pose(), Pose.exp(np.array([0.1, 0.2, 0, 0, 0.1, 0])), CAUCHY)
    node = Node(0, 0, pose, absolute={KIND.name: 7.0}, offsets={OFFSET.name: np.array([4.0])})
    (factor,) = KIND.factors(None, node, frames)
    values = gtsam.Values()
    for variable in (POSE, OFFSET):
        values.insert(variable.key(node), variable.of(node, frames.rig_from_body))
    sensor = pose.apply(barometer.rig_from_sensor.translation)
    assert factor.squared(values) * barometer.height_noise_m**2 == pytest.approx((sensor[2] + 4 - 7) ** 2)
    derivatives, _ = factor.value.linearize(values).jacobian()

    def residual(change: np.ndarray) -> float:
        moved = gtsam.Values()
        moved.insert(POSE.key(node), POSE.of(node, frames.rig_from_body).retract(change[:6]))
        moved.insert(OFFSET.key(node), np.array([4.0 + change[6]]))
        return float(np.sqrt(factor.squared(moved)))

    steps = 1e-5 * np.eye(7)
    numeric = np.array([[(residual(step) - residual(-step)) / 2e-5 for step in steps]])
    factor_of_loss = derivatives[0, 6] / numeric[0, 6]
    np.testing.assert_allclose(derivatives, factor_of_loss * numeric, atol=1e-6)


def vertical_error(run: of_fused.Run) -> float:
    """Returns the RMS error [m] of the heights relative to the first one."""
    heights = {t: -pose.translation[1] for t, pose in run.final.items()}
    true = {t: -pose.translation[1] for t, pose in run.truth.items()}
    errors = np.array([heights[t] - true[t] for t in heights])
    return float((errors - errors[0]).std())


def test_it_holds_the_height_of_wheels_and_images_that_drift() -> None:
    pytest.importorskip("gtsam")
    wheel = of_fused.EXACT["wheel"]
    config = of_fused.FusedConfig(node_s=0.4, window=6, turn_deg=0.5)
    without = of_fused.Run(config, {"wheel": wheel}, turn=4e-3)
    air = SimulatedBarometer(noise_m=0.02, drift_m=1e-3)
    run = of_fused.Run(config, {"wheel": wheel, "barometer": air}, turn=4e-3)
    assert len(run.final) == len(run.truth)
    assert vertical_error(run) < 0.5 * vertical_error(without)
    assert all(d.passed for d in run.values("barometer_misfit"))
    assert run.values("barometer_gain")[-1].value > 1


def test_its_offset_may_be_large_and_drift() -> None:
    """The exact path stays exact, whatever the level and the drift of the air are."""
    pytest.importorskip("gtsam")
    air = SimulatedBarometer(noise_m=0.01, drift_m=0.05, level_m=8000)
    run = of_fused.Run(of_fused.config("auto"), {**of_fused.chosen("3"), "barometer": air})
    assert run.error_m < 0.03
    assert all(d.passed for d in run.values("barometer_misfit"))
    offset = run.state.nodes[-1].offsets[OFFSET.name]
    assert offset.shape == (1,) and offset[0] == pytest.approx(8000, abs=3)


@pytest.mark.slow
def test_fused_tight_uses_it() -> None:
    pytest.importorskip("gtsam")
    sensors = {"gnss": of_tight.GNSS, "barometer": SimulatedBarometer(noise_m=0.02, drift_m=1e-3)}
    run = of_tight.Run(of_tight.config("auto"), of_tight.drive, True, **sensors)
    keys = {d.key: d for step in run.steps for d in step.decisions}
    assert run.error_m < 0.05 and keys["barometer_misfit"].passed and keys["barometer_gain"].value > 1


class Altimeters(BarometerKind):
    """A kind that a notebook adds."""

    name, label, phrase = "altimeter", "Altimeter", "an altimeter"


def test_a_notebook_registers_a_kind() -> None:
    assert "altimeter" not in method("fused").sensors
    kind = Altimeters()
    ispom.register(kind)
    try:
        assert "altimeter" in method("fused").sensors and "altimeter_misfit" in method("fused").checks
        assert SENSOR_KINDS.get("altimeter") is kind
        ispom.register(Altimeters())  # a cell runs again
    finally:
        SENSOR_KINDS.remove(SENSOR_KINDS.get("altimeter"))
    assert "altimeter" not in method("fused").sensors
    with pytest.raises(ispom.InputError):
        ispom.register(BarometerKind())


def test_it_has_a_row_on_the_time_axis() -> None:
    from ispom_app.views.web.time_axis import FRAMES, sensor_letters

    letters = sensor_letters()
    assert letters["barometer"] == "b" and letters["imu"] == "i"
    assert len({*letters.values(), *FRAMES.values(), "o"}) == len(letters) + len(FRAMES) + 1
