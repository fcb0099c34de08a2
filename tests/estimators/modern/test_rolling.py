"""A rolling shutter whose line delay is known: points are put where the middle row's exposure would have seen them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.ensemble import build
from ispom.estimators.modern.rolling import Flow, Speeds, late_px
from ispom.evaluation.metrics import path_errors
from ispom.methods import Config
from ispom.sequences.formats.simulated import open_simulated
from ispom.simulation.scenario.calibrations import WrongShutter
from ispom.simulation.scenario.scenario import World
from ispom.types import Camera, Rig

INTERVAL_S, READOUT_S = 1 / 30, 0.02
CAMERA = Camera(640, 480, 450.0, 450.0, 319.5, 239.5, line_delay_s=READOUT_S / 479)


def test_constant_velocities_are_undone_exactly() -> None:
    rng = np.random.default_rng(0)
    at_middle = rng.uniform((50, 50), (590, 430), (40, 2))
    velocity = rng.uniform(-300, 300, (40, 2))

    def seen(time_s: float) -> np.ndarray:
        """Of the image whose middle row is exposed then: a point's row is the one that is exposed where it is."""
        middle, rate = (CAMERA.height - 1) / 2, CAMERA.line_delay_s
        here = at_middle + time_s * velocity
        late_s = rate * (here[:, 1] - middle) / (1 - rate * velocity[:, 1])
        return here + late_s[:, None] * velocity

    before, last, now = (seen(k * INTERVAL_S) for k in (-4, -1, 0))  # some images were dropped
    speeds = Speeds.of(CAMERA, Flow(now - last, INTERVAL_S), Flow(last - before, 3 * INTERVAL_S))
    for each in (speeds.before, speeds.last, speeds.now):
        np.testing.assert_allclose(each, velocity, atol=0.01)
    assert np.abs(now - at_middle).max() > 2
    assert np.abs(now - late_px(CAMERA, now, speeds.now) - at_middle).max() < 1e-3


def test_velocities_change_between_images_of_unlike_distances() -> None:
    """Of points that are accelerated along the rows, so that all is seen at the images' times; one of them is new."""
    velocity, gain = np.array([[90.0, 0], [-60.0, 0], [30.0, 0]]), np.array([900.0, 0])

    def moved(begin_s: float, end_s: float) -> np.ndarray:
        return velocity * (end_s - begin_s) + 0.5 * gain * (end_s**2 - begin_s**2)

    known = np.array([[1.0], [1.0], [0.0]])
    before = known * moved(-4 * INTERVAL_S, -INTERVAL_S)
    speeds = Speeds.of(CAMERA, Flow(moved(-INTERVAL_S, 0), INTERVAL_S), Flow(before, 3 * INTERVAL_S))
    np.testing.assert_allclose(speeds.now, velocity, atol=1e-3)
    np.testing.assert_allclose(speeds.last, velocity - INTERVAL_S * gain, atol=1e-3)
    np.testing.assert_allclose(speeds.before[:2], (velocity - 4 * INTERVAL_S * gain)[:2], atol=1e-3)


def test_a_camera_of_another_size_rolls_as_long() -> None:
    half = CAMERA.scaled(0.5)
    assert half.line_delay_s * half.height == pytest.approx(CAMERA.line_delay_s * CAMERA.height)


@pytest.mark.slow
def test_known_line_delays_make_good_a_rolling_shutter(tmp_path: Path) -> None:
    world, methods = World(rolling_shutter_ms=1e3 * READOUT_S), ("monocular", "stereo", "integrated")
    told = open_simulated("tiny", seed=0, cache_dir=tmp_path, duration_s=2.4, world=world)
    exposures, truth = [told[i] for i in range(len(told))], told.truth
    assert truth is not None

    def errors_m(rig: Rig) -> list[float]:
        ensemble = build(Config(), methods, rig)
        state = ensemble.start()
        for exposure in exposures:
            state, _ = ensemble.step(state, exposure)
        return [path_errors(t, truth, rig, t.frame == "rig")["ate_m"] for t in ensemble.finish(state).values()]

    blind = errors_m(WrongShutter().on(told, 0).rig)
    assert (np.array(blind) > np.array([2, 8, 8]) * errors_m(told.rig)).all()
