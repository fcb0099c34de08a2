"""One camera corrects its focal length and distortion in the window, where the motion shows them."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.solvers.window.adjustment import Window, adjust
from ispom.solvers.window.prior import anchored

EXTRA = np.array([0.004, 0.012])


def window() -> tuple[Window, np.ndarray]:
    """Eight views of a turning, travelling camera with a slightly wrong calibration, at a wrong first guess."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform((-6, -3, 4), (6, 3, 14), (150, 3))
    poses = [
        Pose.from_rotvec(np.array([0.02 * i, -0.09 * i, 0.03 * i]), np.array([0.3 * i, 0.05 * i, 0.1 * i]))
        for i in range(8)
    ]
    p = np.stack([q.apply(xyz) for q in poses], axis=1)
    x = p[..., :2] / p[..., 2:]
    seen = x * (1 + EXTRA[0] + EXTRA[1] * (x**2).sum(-1, keepdims=True))
    count, views = len(xyz), len(poses)
    guess = [q if i < 2 else Pose.exp(rng.normal(0, 0.005, 6)) @ q for i, q in enumerate(poses)]
    sigma = np.array([0.02, 0.05])
    return Window(
        np.stack([q.rotation for q in guess]),
        np.stack([q.translation for q in guess]),
        xyz * rng.normal(1, 0.01, (count, 1)),
        np.tile(np.arange(views), count),
        np.repeat(np.arange(count), views),
        np.column_stack([seen.reshape(-1, 2), np.full(count * views, np.nan)]),
        extra=np.zeros(2),
        extra_sigma=sigma,
        prior=anchored(guess[0].rotation, guess[0].translation, sigma),
        fixed=2,
    ), np.stack([q.translation for q in poses])


def test_the_correction_is_found() -> None:
    start, translations = window()
    found = adjust(start, 1e-3, 40, 1e-12)
    np.testing.assert_allclose(found.window.extra, EXTRA, rtol=0.02)
    np.testing.assert_allclose(found.window.translations, translations, atol=2e-3)
    assert found.distances.max() < 1e-4
