"""The height prior of a ground vehicle: a residual family of the window, from its derivatives to its influence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.height import HeightPrior, height_prior
from ispom.estimators.modern.stereo.map import optimise
from ispom.estimators.modern.stereo.pair import Setup
from ispom.estimators.modern.stereo.rolling_window import rolling_without_oldest
from ispom.estimators.modern.stereo.shutter import row_times
from ispom.estimators.modern.stereo.state import KeyFrame, StereoMap
from ispom.estimators.modern.stereo.window import packed, without_oldest
from ispom.geometry import Pose
from ispom.numerics.twist import moved
from ispom.solvers.influence.problem import collecting_problems
from ispom.solvers.window.adjustment import Window, adjust, covariance, marginalise
from ispom.solvers.window.prior import POSE
from ispom.types import Camera, Rig
from tests.estimators.modern.setups import setup_of
from tests.nees import band

CAMERA, BASELINE_M, NOISE_PX, SIGMA_M, POINTS = Camera(640, 480, 460.0, 460.0, 319.5, 239.5), 0.3, 1.0, 0.005, 80
TILT = Pose.from_rotvec(np.array([0.05, 0.0, 0.03]), np.zeros(3))
"""rig_from_left of a camera that does not look along the road."""


def setup(height_sigma_m: float = SIGMA_M) -> Setup:
    """Returns the setup of a pair with a loss as wide as its noise, and no self-calibration."""
    config = ModernStereoConfig(
        self_calibration=False, loss_px=NOISE_PX, max_error_px=10.0, height_sigma_m=height_sigma_m, iterations=30
    )
    return setup_of(config.build(Rig.stereo(CAMERA, BASELINE_M)))


def drive(seed: int, keys: int, sigma_m: float) -> list[Pose]:
    """Returns left_from_world of a drive ahead over a hill, whose height changes by `sigma_m` from pose to pose."""
    rng, pose, poses = np.random.default_rng(seed), Pose(), [Pose()]
    for _ in range(keys - 1):
        turn = rng.normal(0, 0.05, 3)
        pose = Pose.from_rotvec(turn, np.zeros(3)) @ Pose(np.eye(3), -np.array([0, rng.normal(0, sigma_m), 1.0])) @ pose
        poses.append(pose)
    return poses


def mapped(seed: int, poses: list[Pose], noise_px: float, of: Setup) -> StereoMap:
    """Returns a map with points ahead that all keyframes observe, before its optimisation."""
    rng = np.random.default_rng(1000 + seed)
    near = np.column_stack([rng.uniform(-0.6, 0.6, POINTS), rng.uniform(-0.4, 0.4, POINTS), np.ones(POINTS)])
    xyz, ids, world = near * rng.uniform(15, 80, (POINTS, 1)), np.arange(POINTS), StereoMap()
    for i, pose in enumerate(poses):
        q = pose.apply(xyz)
        seen = np.column_stack([q[:, :2], q[:, 0] - BASELINE_M]) / q[:, 2:]
        seen += noise_px / CAMERA.fx * rng.standard_normal(seen.shape)
        world = world.with_key(of, KeyFrame(i * 10**8, pose, ids, seen, np.zeros(12), np.zeros((POINTS, 2))))
    return world.with_points(ids, xyz)


def window_of(poses: list[Pose]) -> Window:
    """Returns a window with these poses and no points."""
    none = np.zeros(0, np.int64)
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    return Window(rotations, translations, np.zeros((0, 3)), none, none, np.zeros((0, 3)))


@pytest.mark.parametrize("rig_from_left", [Pose(), TILT], ids=["level", "tilted"])
def test_a_rig_that_moves_in_its_plane_has_no_residual(rig_from_left: Pose) -> None:
    left_from_rig = rig_from_left.inverse()
    window = window_of([left_from_rig @ pose @ rig_from_left for pose in drive(0, 6, 0.0)])
    family = HeightPrior(np.ones(5), 1.0, rig_from_left.rotation[1])
    np.testing.assert_allclose(family.residuals(window), 0, atol=1e-12)


def test_the_derivatives_are_those_of_the_residuals() -> None:
    window = window_of(drive(1, 5, 0.3))
    family = HeightPrior(np.ones(4), 1.0, TILT.rotation[1])
    derivatives, count = family.derivatives(window), POSE * len(window.rotations)
    found = np.zeros((4, count))
    np.add.at(found, (np.arange(4)[:, None], derivatives.columns), derivatives.by_shared[:, 0])
    for k in range(count):
        ends = []
        for step in (1e-6, -1e-6):
            twists = np.zeros(count)
            twists[k] = step
            rotations, translations = moved(window.rotations, window.translations, twists.reshape(-1, POSE))
            ends.append(family.residuals(replace(window, rotations=rotations, translations=translations))[:, 0])
        np.testing.assert_allclose(found[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)


def test_what_leaves_with_the_oldest_keyframe_counts_once() -> None:
    """At the optimum, a window without its oldest keyframe and points has the covariance that it had with them."""
    made = setup()
    world = mapped(0, drive(0, 5, SIGMA_M), NOISE_PX, made)
    whole = adjust(packed(made, world)[0], made.noise.width, 60, 1e-14).window
    prior = marginalise(whole, np.ones(POINTS, bool), made.noise.width)
    none = np.zeros(0, np.int64)
    family = whole.families[0]
    assert isinstance(family, HeightPrior)
    rest = replace(
        whole,
        rotations=whole.rotations[1:],
        translations=whole.translations[1:],
        points=np.zeros((0, 3)),
        cameras=none,
        owners=none,
        seen=np.zeros((0, 3)),
        factors=whole.factors[:0],
        prior=prior,
        families=(replace(family, widths=family.widths[1:]),),
    )
    wanted = covariance(whole, made.noise.width)[POSE:, POSE:]
    np.testing.assert_allclose(covariance(rest, made.noise.width), wanted, rtol=1e-5, atol=1e-14)


def test_heights_are_better_and_covariances_are_those_of_the_errors() -> None:
    nees, errors = [], {0.0: [], SIGMA_M: []}
    for seed in range(24):
        true = drive(seed, 5, SIGMA_M)
        for sigma_m, found in errors.items():
            made = setup(sigma_m)
            world = mapped(seed, true, NOISE_PX, made)
            for _ in range(4):  # until it has converged
                world, _ = optimise(made, world)
            off = (world.keys[-1].left_from_world @ true[-1].inverse()).log()
            found.append(off[1])
            if sigma_m:
                assert world.newest is not None
                nees.append(off @ np.linalg.solve(world.newest, off))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high
    assert np.std(errors[SIGMA_M]) < 0.6 * np.std(errors[0.0])


def test_a_rolling_shutter_marginalises_it_as_a_global_one() -> None:
    """Rows that are exposed within a microsecond."""
    made = setup()
    world, _ = optimise(made, mapped(0, drive(0, 5, SIGMA_M), NOISE_PX, made))
    camera = replace(CAMERA, line_delay_s=1e-9)
    keys = tuple(replace(key, late_s=row_times(camera, key.seen[:, 1])) for key in world.keys)
    rolled = rolling_without_oldest(replace(made, camera=camera), replace(world, keys=keys)).prior
    prior, poses = without_oldest(made, world).prior, slice(POSE * 2)  # the two newest keep their observations
    assert prior is not None and rolled is not None
    unit = 1 / np.sqrt(prior.hessian.diagonal()[poses])
    scaled, of_rolled = (np.outer(unit, unit) * p.hessian[poses, poses] for p in (prior, rolled))
    np.testing.assert_allclose(of_rolled, scaled, atol=1e-4)
    without = without_oldest(setup(0.0), world).prior
    assert without is not None
    assert np.abs(np.outer(unit, unit) * without.hessian[poses, poses] - scaled).max() > 1e-2


def test_its_influence_is_that_of_solving_without_it() -> None:
    made = setup(0.005)
    with collecting_problems() as problems:
        optimise(made, mapped(3, drive(3, 5, 0.02), NOISE_PX, made))
    (problem,) = problems
    (part,) = [p for p in problem.parts if p.name == "height prior"]
    (shift,), really = problem.shifts((part,)), problem.really(part)
    assert really.size > 1e-4
    np.testing.assert_allclose(shift.position, really.position, atol=0.05 * really.size)


def test_it_is_off_by_default() -> None:
    assert setup_of(ModernStereoConfig().build(Rig.stereo(CAMERA, BASELINE_M))).families(StereoMap()) == ()
    assert height_prior(setup(), StereoMap(), 0.1).widths.shape == (0,)
