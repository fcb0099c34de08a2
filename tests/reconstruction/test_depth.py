"""Dense depth of rendered pairs against the renderer's own."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.reconstruction.depth import DenseStereo
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Flight
from ispom.simulation.places.city import build_city
from ispom.simulation.rendering.renderer import Renderer, exposed

RIG = simulated_rig(0.5)
POSE = Flight.seeded(0).pose_at(9_000_000_000)


@pytest.fixture(scope="module")
def seen() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right image, and the left one's depth."""
    renderer = Renderer(build_city(0))
    left, right = (
        exposed(renderer.image(RIG.camera(name), POSE @ RIG.rig_from(name), 2), noise, 1.6)
        for noise, name in enumerate(("left", "right"))
    )
    return left, right, renderer.depth(RIG.camera("left"), POSE @ RIG.rig_from_left)


def disparity_errors(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """[px] where depth is known."""
    known = found > 0
    return RIG.camera("left").fx * RIG.baseline_m * (1 / found[known] - 1 / true[known])


def test_depth_is_that_of_the_place(seen) -> None:
    left, right, true = seen
    found = DenseStereo().depth(left, right, RIG.camera("left"), RIG.baseline_m, 10.0)
    errors = disparity_errors(found, true)
    near = true < 9.5
    assert (found[near] > 0).mean() > 0.6
    assert found.max() <= 10
    assert abs(np.median(errors)) < 0.02 and np.median(np.abs(errors)) < 0.15
    assert np.percentile(np.abs(errors), 90) < 0.5


def test_the_sub_pixel_step_takes_away_what_matching_rounds(seen) -> None:
    left, right, true = seen
    whole, refined = (
        disparity_errors(s.depth(left, right, RIG.camera("left"), RIG.baseline_m, 10.0), true)
        for s in (DenseStereo(refinements=0), DenseStereo())
    )
    assert np.median(np.abs(refined)) < 0.7 * np.median(np.abs(whole))


def test_without_texture_nothing_is_known() -> None:
    plain = np.random.default_rng(0).normal(120, 1.6, (2, 240, 320)).astype(np.uint8)
    found = DenseStereo().depth(plain[0], plain[1], RIG.camera("left"), RIG.baseline_m, 10.0)
    assert (found > 0).mean() < 0.01
