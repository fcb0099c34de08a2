"""A pair on a motorway: what is seen is far, and an offset of the disparities makes all of it nearer or farther."""

from __future__ import annotations

import numpy as np

from ispom.solvers.window.adjustment import Window, adjust
from ispom.solvers.window.prior import anchored

F, BASELINE, OFFSET_PX = 720.0, 0.54, 0.3


def window() -> Window:
    """Four views, 2.5 m apart, of points 50 to 500 m away; a first guess from the disparities as they are."""
    rng = np.random.default_rng(1)
    depth = 1 / rng.uniform(1 / 500, 1 / 50, 200)
    xyz = np.column_stack([rng.uniform(-0.6, 0.6, 200), rng.uniform(-0.2, 0.1, 200), np.ones(200)]) * depth[:, None]
    ahead = 2.5 * np.arange(4)
    p = xyz[:, None] - np.column_stack([0 * ahead, 0 * ahead, ahead])
    x, right = p[..., :2] / p[..., 2:], (p[..., 0] - BASELINE) / p[..., 2]
    seen = np.dstack([x, right + OFFSET_PX / F]) + rng.normal(0, 0.05 / F, (200, 4, 3))
    guess = np.dstack([seen[:, 0, 0], seen[:, 0, 1], np.ones(200)])[0]
    guess *= (BASELINE / np.maximum(seen[:, 0, 0] - seen[:, 0, 2], 1 / 2000))[:, None]
    sigma = np.array([0.0, 0.0, 0.5 / F])
    return Window(
        np.tile(np.eye(3), (4, 1, 1)),
        np.column_stack([0 * ahead, 0 * ahead, -1.05 * ahead]),
        guess,
        np.tile(np.arange(4), 200),
        np.repeat(np.arange(200), 4),
        seen.reshape(-1, 3),
        BASELINE,
        extra=np.zeros(3),
        extra_sigma=sigma,
        factors=np.tile([0.0, 0.0, 1.0], (800, 1)),
        prior=anchored(np.eye(3), np.zeros(3), sigma),
    )


def test_the_offset_is_found_from_far_points_in_a_few_steps() -> None:
    found = adjust(window(), 0.34 / F, 5).window
    np.testing.assert_allclose(found.extra[2] * F, OFFSET_PX, atol=0.03)
    np.testing.assert_allclose(-found.translations[:, 2], 2.5 * np.arange(4), atol=0.02)
