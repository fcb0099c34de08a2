"""The weakest combination of the numbers, against numerical derivatives and against refits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.evaluation.doctor.adjustment import adjust
from ispom.evaluation.doctor.groups import has
from ispom.evaluation.doctor.hypothesis import STEPS, change_of
from ispom.evaluation.doctor.scene import Observations, Scene, predicted
from ispom.evaluation.undecided.motions import looked_at, motion_of, with_motion
from ispom.evaluation.undecided.stretches import of_motion, spans
from ispom.evaluation.undecided.weakest import BASELINE, SCALE, Decided, decided
from ispom.geometry import Array, so3_exp
from ispom.simulation.cameras import simulated_rig
from ispom.types import Rig, Trajectory

RIG = simulated_rig(0.5)
ALONE = Rig.of(video=RIG.camera("video"))
EXACT_PX = 0.003
"""Of observations whose weights in the robust loss are 1."""


def scene(turn_deg: float = 10.0, points: int = 90, knots: int = 10) -> Scene:
    """A straight flight of 3 m, on which the rig pans and rolls by so much, past points at 4 to 20 m."""
    rng = np.random.default_rng(0)
    share = np.linspace(0, 1, knots)
    turns = np.radians(turn_deg) * np.column_stack([0 * share, share, 0.5 * np.sin(np.pi * share)])
    depths = rng.uniform(4, 20, points)
    xyz = np.stack([rng.uniform(-0.5, 0.5, points) * depths, rng.uniform(-0.4, 0.4, points) * depths, depths + 3], 1)
    return Scene(1.5 * share, so3_exp(turns), np.outer(share, [0.0, 0.0, 3.0]), xyz)


def seen_by(world: Scene, rig: Rig, noise_px: float, seed: int = 1) -> Observations:
    cameras = [0] if rig is ALONE else [0, 1, 2]
    return looked_at(world, rig, cameras, np.arange(len(world.points)), world.times_s, noise_px, seed)


def numerical(world: Scene, rig: Rig, seen: Observations) -> tuple[tuple[str, ...], Array, Array]:
    """Returns the names of the numbers, their effects (N,) [px], and their covariance (N, N) for a noise of 1 px, from
    differences of residuals."""
    names = tuple(name for name in STEPS if name != BASELINE and has(rig, name))

    def residuals(poses: Array, points: Array, numbers: Array) -> Array:
        moved = world.moved(np.vstack([np.zeros(6), poses.reshape(-1, 6)]), points.reshape(-1, 3))
        return predicted(moved, rig, change_of(names, numbers), seen, False).residuals.ravel()

    sizes = (6 * (len(world.times_s) - 1), 3 * len(world.points), len(names))
    steps = np.concatenate([np.full(sizes[0] + sizes[1], 1e-6), [STEPS[name] / 10 for name in names]])
    columns, here = [], residuals(*(np.zeros(size) for size in sizes))
    for k, step in enumerate(steps):
        # Forwards: a delay leads from the motion before a pose to the motion after it.
        parts = np.split(step * np.eye(len(steps))[k], np.cumsum(sizes)[:2])
        columns.append((residuals(*parts) - here) / step)
    slopes = np.column_stack(columns)
    by_number = slopes[:, -len(names) :].reshape(len(seen), 2, -1)
    effects = np.max([np.sqrt((by_number[seen.camera == c] ** 2).mean(axis=(0, 1))) for c in set(seen.camera)], axis=0)
    others, own = np.split(slopes / np.linalg.norm(slopes, axis=0), [-len(names)], axis=1)
    left, sizes_of, _ = np.linalg.svd(others, full_matrices=False)
    left = left[:, sizes_of > 1e-7 * sizes_of[0]]  # without the unit of one camera alone
    root = np.linalg.inv(np.linalg.qr(own - left @ (left.T @ own))[1])
    lengths = np.linalg.norm(slopes[:, -len(names) :], axis=0)
    return names, effects, root @ root.T / np.outer(lengths, lengths)


@pytest.mark.parametrize("turn_deg", [0.5, 10.0])
@pytest.mark.parametrize("rig", [ALONE, RIG], ids=["alone", "rig"])
def test_the_weakest_combination_is_that_of_numerical_derivatives(rig: Rig, turn_deg: float) -> None:
    world = scene(turn_deg, 50, 7)
    seen = seen_by(world, rig, EXACT_PX)
    found = decided(world, rig, seen)
    names, effects, covariance = numerical(world, rig, seen)
    own = [i for i, name in enumerate(found.names) if name != SCALE]
    assert [found.names[i] for i in own] == list(names)
    assert found.effects_px[own] == pytest.approx(effects, rel=1e-3)
    by_effect = covariance * effects[:, None] * effects * found.noise_px**2
    without_scale = Decided(names, effects, found.covariance[np.ix_(own, own)], found.noise_px)
    values, vectors = np.linalg.eigh(by_effect)
    assert without_scale.weakest_px == pytest.approx(np.sqrt(values[-1]), rel=0.02)
    for part in without_scale.weakest:
        assert abs(part.px) == pytest.approx(np.sqrt(values[-1]) * abs(vectors[names.index(part.name), -1]), rel=0.05)


def test_the_noise_is_that_of_the_observations() -> None:
    world = scene()
    assert decided(world, ALONE, seen_by(world, ALONE, 0.05)).noise_px == pytest.approx(0.05, rel=0.15)


@pytest.mark.slow
def test_refits_differ_by_as_much_as_it_says() -> None:
    world = scene(50.0)
    names = tuple(name for name in STEPS if has(ALONE, name))
    truth = decided(world, ALONE, seen_by(world, ALONE, 0.1))
    changes = [adjust(world, ALONE, seen_by(world, ALONE, 0.1, seed), names, 100)[1] for seed in range(24)]
    spread = np.std([[change.value(name) for name in names] for change in changes], axis=0)
    # An adjustment ends a little before the end of the longest valley.
    ratios = spread / [truth.sigma(name) for name in names]
    assert (ratios > 0.5).all() and (ratios < 1.4).all()


def test_moving_straight_on_leaves_centre_or_lens_free_and_a_turn_decides_them() -> None:
    straight, turning = scene(0.0), scene(20.0)
    free = decided(straight, ALONE, seen_by(straight, ALONE, 0.3))
    held = decided(turning, ALONE, seen_by(turning, ALONE, 0.3))
    assert free.weakest_px > 5 * held.weakest_px
    assert free.weakest[0].name in ("video_focal_percent", "video_centre_x_px", "video_centre_y_px")
    cured = with_motion(straight, ALONE, seen_by(straight, ALONE, 0.3), "pan", 0.3)
    assert cured.weakest_px < free.weakest_px / 3


def test_scale_is_listed_with_a_pair_only_and_is_less_sure_farther_away() -> None:
    near = scene()
    far = replace(near, points=near.points * 10)
    sigmas = [decided(each, RIG, seen_by(each, RIG, 0.3)).sigma(SCALE) for each in (near, far)]
    assert 0 < sigmas[0] < sigmas[1]
    assert SCALE not in decided(near, ALONE, seen_by(near, ALONE, 0.3)).names


def test_the_motion_is_described() -> None:
    moved = motion_of(scene(20.0))
    assert moved.turned_deg == pytest.approx(20.0, rel=0.1) and moved.direction[2] > 0.99
    assert 0.1 < moved.distance < 0.5


def test_a_planned_motion_gets_the_same_answer_as_its_scene() -> None:
    rates = {}
    for turn_deg in (0.0, 25.0):
        world = scene(turn_deg, knots=12)
        poses = Trajectory((world.times_s * 1e9).astype(np.int64), world.rotations, world.positions)
        (only,) = of_motion(poses, ALONE, 8.0, 2.0, 1.0)
        assert only.decided is not None
        rates[turn_deg] = only.decided.weakest_px
        assert bool(only.cures) == (only.decided.weakest_px > 1)
    assert rates[0.0] > 3 * rates[25.0]


def test_a_camera_that_rests_decides_nothing_and_says_so() -> None:
    poses = Trajectory(np.arange(20) * 10**8, np.tile(np.eye(3), (20, 1, 1)), np.zeros((20, 3)))
    (only,) = of_motion(poses, ALONE, 8.0, 2.0, 2.0)
    assert only.decided is None


def test_stretches_cover_the_recording() -> None:
    times_ns = np.arange(100) * 10**8
    assert spans(times_ns, 3.0, 3.0) == [(0, 30), (30, 60), (60, 90)]
    assert spans(times_ns[:8], 3.0, 3.0) == [(0, 7)]
    assert spans(times_ns[:3], 3.0, 3.0) == [] == spans(times_ns[:0], 3.0, 3.0)
