"""A floor with hardly any relief: focal length, turns and depths trade places along a narrow, bent valley."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ispom.calibration.tracked import solve
from ispom.calibration.tracked.scene import Scene, adjust_scene
from ispom.calibration.tracked.solve import TrackedLens, lens_of_tracks, remaining_change
from ispom.calibration.tracked.tracks import Tracks
from ispom.types import Camera
from tests.calibration.tracked.scenes import LENS, over_floor, tracks

SIGMA = 0.3
SEEDS = 5


def solved(seen: Tracks, wrong: float) -> TrackedLens:
    focal = wrong * LENS.fx
    guess = Camera(LENS.width, LENS.height, focal, focal, (LENS.width - 1) / 2, (LENS.height - 1) / 2)
    found = lens_of_tracks(seen, guess, SIGMA)
    assert found is not None
    return found


@pytest.mark.parametrize("wrong", [0.7, 1.3])
def test_over_an_exact_floor_the_focal_length_is_found(wrong: float) -> None:
    found = solved(tracks(0, over_floor, noise_px=0.0, depths=(2.97, 3.03)), wrong)
    assert found.camera.fx == pytest.approx(LENS.fx, rel=1e-3)
    assert found.camera.distortion[0] == pytest.approx(LENS.distortion[0], abs=1e-3)
    assert found.sigma[0] < 2e-3


@pytest.mark.slow
def test_over_a_noisy_floor_it_is_as_sure_as_it_is_near_whatever_the_guess() -> None:
    away, sigma = np.zeros((SEEDS, 2)), np.zeros((SEEDS, 2))
    for seed in range(SEEDS):
        for i, wrong in enumerate((0.7, 1.3)):
            found = solved(tracks(seed, over_floor, 10, 400, 0.05, depths=(2.9, 3.1)), wrong)
            away[seed, i], sigma[seed, i] = np.log(found.camera.fx / LENS.fx), found.sigma[0]
    assert (np.abs(away[:, 0] - away[:, 1]) < sigma.min(1)).all()
    assert np.sqrt(((away / sigma) ** 2).mean()) < 1.5 and (np.abs(away) < 3 * sigma).all()
    assert sigma.max() < 0.02


def test_where_the_lens_still_goes_it_says_how_far() -> None:
    shrinking = np.array([0.5, -0.5, 0.0, 0.1, -0.2])
    np.testing.assert_allclose(remaining_change(shrinking, 0.5 * shrinking), 0.5 * shrinking, atol=1e-15)
    assert remaining_change(np.ones(1), np.ones(1)) == pytest.approx(9.0), "a step that does not shrink: nine more"
    assert remaining_change(np.ones(1), -np.ones(1)) == pytest.approx(9 / 19), "to and fro: half a step"


def test_what_is_left_to_go_is_in_the_standard_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """With straight steps it stays a third below the truth."""

    def adjust_straight(*args: Any, curved: bool) -> tuple[Scene, float]:
        return adjust_scene(*args, curved=False)

    monkeypatch.setattr(solve, "adjust_scene", adjust_straight)
    found = solved(tracks(0, over_floor, noise_px=0.0, depths=(2.97, 3.03)), 0.7)
    assert abs(np.log(found.camera.fx / LENS.fx)) < 3 * found.sigma[0]
