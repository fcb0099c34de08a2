"""A rolling shutter whose line delay is known: points are put where the middle row's exposure would have seen them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.rolling import late_px, speed_px_s
from ispom.sequences.formats.simulated import open_simulated
from ispom.simulation.scenario.scenario import World
from ispom.types import Camera, Rig, VideoFrame
from tests.estimators.modern.test_monocular import ate, finish, video_truth

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

    before, last, now = (seen(k * INTERVAL_S) for k in (-2, -1, 0))
    late = late_px(CAMERA, now, speed_px_s(CAMERA, now - last, last - before, INTERVAL_S))
    assert np.abs(now - at_middle).max() > 2
    assert np.abs(now - late - at_middle).max() < 1e-3


def test_a_camera_of_another_size_rolls_as_long() -> None:
    half = CAMERA.scaled(0.5)
    assert half.line_delay_s * half.height == pytest.approx(CAMERA.line_delay_s * CAMERA.height)


def test_a_known_line_delay_makes_good_a_rolling_shutter(tmp_path: Path) -> None:
    world = World(rolling_shutter_ms=1e3 * READOUT_S)
    sequence = open_simulated("tiny", seed=0, cache_dir=tmp_path, duration_s=2.4, world=world)
    frames = [e for i, kind in enumerate(sequence.kinds) if kind == "video" if isinstance(e := sequence[i], VideoFrame)]
    known, truth = sequence.rig.camera("video"), video_truth(sequence)
    camera = replace(known, line_delay_s=0.0)
    blind, found = (
        ate(finish(ModernMonocularConfig().build(Rig.single(each)), frames)[0], truth)[0] for each in (camera, known)
    )
    assert found < 0.5 * blind
