"""A camera that stays where it is and turns and zooms is explained; one that travels is not."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Array, so3_exp
from ispom.solvers.multiview.zoom import turn_and_zoom

TURN = np.array([0.05, -0.2, 0.1])
SCALE = 1e-3


def scene(count: int = 150) -> Array:
    rng = np.random.default_rng(0)
    return rng.uniform((-2, -1.5, 3), (2, 1.5, 9), (count, 3))


def seen(xyz: Array, focal: float) -> Array:
    return focal * xyz[:, :2] / xyz[:, 2:]


@pytest.mark.parametrize("focal", [1.0, 1.25])
@pytest.mark.parametrize("zoom", [1.0, 0.8, 1.4])
def test_turn_and_zoom_are_found_exactly(focal: float, zoom: float) -> None:
    x1, x2 = seen(scene(), focal), seen(scene() @ so3_exp(TURN).T, focal * zoom)
    found = turn_and_zoom(x1, x2, SCALE)
    assert found.distances(x1, x2).max() < 1e-6
    assert found.zoom == pytest.approx(zoom, abs=1e-5) and found.focal == pytest.approx(focal, abs=1e-4)
    assert np.allclose(found.rotation, so3_exp(TURN), atol=1e-5)


def test_what_moves_by_itself_does_not_matter() -> None:
    x1, x2 = seen(scene(), 1.0), seen(scene() @ so3_exp(TURN).T, 1.1)
    x2[:50] += 0.1
    assert turn_and_zoom(x1, x2, SCALE).distances(x1, x2)[50:].max() < 0.1 * SCALE


def test_a_still_background_is_found_behind_what_most_points_are_on() -> None:
    x1 = seen(scene(), 1.0)
    x2 = seen(scene() @ so3_exp(np.array([0.0, 0.3, 0.1])).T + (0.3, 0, 0.5), 1.0)
    x2[:60] = x1[:60]
    weights = np.where(np.arange(150) < 60, 3.0, 1.0)
    assert turn_and_zoom(x1, x2, SCALE, weights).distances(x1, x2)[:60].max() < 0.1 * SCALE


@pytest.mark.parametrize("way", [(0.5, 0, 0), (0, 0, 1.0)])
def test_travel_is_not_explained(way: tuple[float, float, float]) -> None:
    x1, x2 = seen(scene(), 1.0), seen(scene() - way, 1.0)
    assert np.median(turn_and_zoom(x1, x2, SCALE).distances(x1, x2)) > 5 * SCALE
