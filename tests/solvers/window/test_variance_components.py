"""Forms of residuals and their expectations, against the formulas with projectors and whole covariances."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Array, Pose
from ispom.numerics.reprojection import reprojected
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import LENS
from ispom.solvers.window.variance_components import residual_forms

SCALE, LEAST, GROSS = 2e-3, 3, 10.0


def window(baseline: float) -> Window:
    """Tracks of 2 to 6 views; an error of the second one is gross, the third one lies in a line of sight (no basis)."""
    rng = np.random.default_rng(0)
    poses = [Pose.from_rotvec(rng.normal(0, 0.05, 3), np.array([-0.4 * i, 0.1 * i, -0.1 * i])) for i in range(6)]
    turns, shifts = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    points = np.column_stack([rng.uniform(-3, 3, (9, 2)), rng.uniform(5, 15, 9)])
    points[2, 2] = 1e12
    first, count = rng.integers(0, 2, 9), np.array([2, 3, 5, 4, 3, 5, 4, 5, 2])
    cameras = np.concatenate([f + np.arange(n) for f, n in zip(first, count, strict=True)])
    owners = np.repeat(np.arange(9), count)
    near = np.einsum("kij,kj->ki", turns[cameras], points[owners]) + shifts[cameras]
    seen = np.column_stack([near[:, :2], near[:, 0] - baseline]) / near[:, 2:] + rng.normal(0, 1e-3, (len(near), 3))
    seen[3] += 0.1
    extra = np.zeros(PAIR if baseline else LENS)
    factors = np.zeros((len(near) if baseline else 0, len(extra)))
    return Window(turns, shifts, points, cameras, owners, seen, baseline, extra, extra, factors)


def written_down(w: Window) -> tuple[Array, Array, float, Array]:
    rows = 3 if w.baseline else 2
    expected, found, total, lengths = np.zeros((3, 3)), np.zeros(3), 0.0, np.zeros(2)
    image = np.array([[1.0, 0, 1], [0, 1, 0], [1, 0, 1]])[:rows, :rows]
    left, right = np.diag([1.0, 1, 0][:rows]), np.diag([0.0, 0, 1])
    for m in (2, 3, 4, 5, 6, 7):
        k = np.flatnonzero(w.owners == m)
        n, turns = len(k), w.rotations[w.cameras[k]]
        near = turns @ w.points[m] + w.translations[w.cameras[k]]
        uv, by_place, _ = reprojected(near)
        by_right, _, _ = reprojected(near - (w.baseline, 0, 0))
        derivatives = np.concatenate([by_place, reprojected(near - (w.baseline, 0, 0))[1][:, :1]], axis=1)[:, :rows]
        errors = (np.column_stack([uv, by_right[:, 0]]) - w.seen[k])[:, :rows]
        a = (derivatives @ turns).reshape(n * rows, 3)
        p = np.eye(n * rows) - a @ np.linalg.pinv(a, rcond=1e-9)
        d, steps = np.diff(np.eye(n), axis=0), np.minimum.outer(np.arange(n), np.arange(n))
        forms = [np.kron(np.eye(n), left), np.kron(d.T @ d, left)]
        causes = [np.kron(np.eye(n), image), np.kron(steps, image)]
        if rows == 3:
            forms, causes = ([*some, np.kron(np.eye(n), right)] for some in (forms, causes))
        weight = float((1 / (1 + (errors**2).sum(axis=1) / SCALE**2)).mean())
        r = errors.ravel()
        for i, s in enumerate(forms):
            found[i] += weight * r @ s @ r
            expected[i, : len(causes)] += [weight * np.trace(s @ p @ c @ p) for c in causes]
        total += weight
        lengths += weight * np.array([n, n * n]) * (w.cameras[k[0]] == 0)
    return expected, found, total, lengths


@pytest.mark.parametrize("baseline", [0.0, 0.3])
def test_sums_are_those_of_projectors(baseline: float) -> None:
    w = window(baseline)
    forms = residual_forms(w.observed, SCALE, LEAST, GROSS)
    for own, wanted in zip(forms[:4], written_down(w), strict=True):
        np.testing.assert_allclose(own, wanted, rtol=1e-9, atol=1e-12)
    assert set(np.unique(w.owners[forms.used])) == {2, 3, 4, 5, 6, 7}
    assert not forms.weighted[~forms.used][w.owners[~forms.used] != 1].any()
