"""Local bundle adjustment: exact data is left alone, disturbed data comes back, the gauge stays."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose
from ispom.solvers.bundle import Bundle, adjust
from ispom.solvers.window import adjustment as window

CAMERAS = tuple(
    Pose.from_rotvec(np.array([0.01 * i, 0.03 * i, 0.0]), np.array([0.3 * i, 0.02 * i * i, 0.5 * i])).inverse()
    for i in range(5)
)


def problem(noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    xyz = rng.uniform([-4, -3, 6], [6, 3, 20], (80, 3))
    camera, point = (a.ravel() for a in np.meshgrid(np.arange(5), np.arange(80), indexing="ij"))
    seen = np.concatenate([(p := c.apply(xyz))[:, :2] / p[:, 2:] for c in CAMERAS])
    return xyz, camera, point, seen + rng.normal(0, noise, seen.shape) if noise else seen


def disturbed(seed: int = 1) -> tuple[Pose, ...]:
    rng = np.random.default_rng(seed)
    return CAMERAS[:2] + tuple(Pose.exp(rng.normal(0, 0.03, 6)) @ c for c in CAMERAS[2:])


def solve(noise: float = 0.0) -> tuple[Bundle, np.ndarray]:
    xyz, camera, point, x = problem(noise)
    start = xyz + np.random.default_rng(2).normal(0, 0.2, xyz.shape)
    return adjust(disturbed(), start, camera, point, x, fixed=2, scale=0.003, iterations=30), xyz


def test_exact_observations_give_the_truth_back() -> None:
    bundle, xyz = solve()
    for found, truth in zip(bundle.cameras_from_world, CAMERAS, strict=True):
        np.testing.assert_allclose((found @ truth.inverse()).log(), 0, atol=1e-6)
    np.testing.assert_allclose(bundle.xyz_in_world, xyz, atol=1e-4)
    assert bundle.cost_after < 1e-6 < bundle.cost_before


def test_noise_and_outliers_leave_small_errors_and_the_fixed_cameras_alone() -> None:
    xyz, camera, point, x = problem(0.0005)
    x[::37] += 0.05
    bundle = adjust(disturbed(), xyz, camera, point, x, fixed=2, scale=0.002, iterations=30)
    for found, truth in zip(bundle.cameras_from_world, CAMERAS, strict=True):
        assert np.abs((found @ truth.inverse()).log()).max() < 0.01
    for found, truth in zip(bundle.cameras_from_world[:2], CAMERAS[:2], strict=True):
        assert np.array_equal(found.matrix, truth.matrix)
    assert np.median(bundle.residuals) < 0.001 < 0.02 < bundle.residuals[::37].min()


def test_same_input_same_bits_in_any_order_of_observations() -> None:
    first, second = solve(0.001)[0], solve(0.001)[0]
    assert all(
        np.array_equal(a.matrix, b.matrix)
        for a, b in zip(first.cameras_from_world, second.cameras_from_world, strict=True)
    )


def test_the_step_is_the_gauss_newton_step_of_the_full_system() -> None:
    """The Schur complement against a dense solve with numerical derivatives."""
    xyz, camera, point, x = problem(0.001)
    few = point < 12
    camera, point, x, xyz = camera[few], point[few], x[few], xyz[:12]
    order = np.argsort(point, kind="stable")
    camera, point, x = camera[order], point[order], x[order]
    rotations, translations = np.stack([c.rotation for c in CAMERAS]), np.stack([c.translation for c in CAMERAS])
    seen3 = np.column_stack([x, np.full(len(x), np.nan)])
    whole = window.Window(rotations, translations, xyz, camera, point, seen3, fixed=2)
    pose_step, point_step, _ = window._step(whole, 1.0, 0.0)

    def residual(parameters: np.ndarray) -> np.ndarray:
        out = []
        for c, m, seen in zip(camera, point, x, strict=True):
            twist = parameters[6 * (c - 2) : 6 * (c - 1)] if c >= 2 else np.zeros(6)
            turn = Pose.from_rotvec(twist[3:], twist[:3])
            p = (turn @ CAMERAS[c]).apply(xyz[m] + parameters[18 + 3 * m : 21 + 3 * m])
            out.append(p[:2] / p[2] - seen)
        return np.concatenate(out)

    zero, step = np.zeros(18 + 36), 1e-6
    jacobian = np.stack([(residual(e) - residual(-e)) / (2 * step) for e in step * np.eye(len(zero))], axis=1)
    dense = -np.linalg.lstsq(jacobian, residual(zero), rcond=None)[0]
    np.testing.assert_allclose(pose_step[2:].ravel(), dense[:18], rtol=0.02, atol=1e-5)
    np.testing.assert_allclose(point_step.ravel(), dense[18:], rtol=0.05, atol=1e-3)
