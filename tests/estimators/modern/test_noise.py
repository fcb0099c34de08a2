"""The noise of tracks from what they leave in an adjusted window: new errors, walks, disparities, shared ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.noise import BELIEVED, TrackNoise
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.adjustment import Adjusted, Window, adjust, covariance
from ispom.solvers.window.prior import LENS
from tests.nees import band

VIEWS, TRACKS, SETTING = 7, 300, 1e-3


def flown(seed: int, errors: dict[str, float], baseline: float = 0.0, cell: float = 0.0) -> Window:
    """At its truth, with errors in its images: `new`, `step`, `disparity`; alike in a `cell` (normalised)."""
    rng, like = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    points = np.column_stack([rng.uniform(-4, 4, TRACKS), rng.uniform(-3, 3, TRACKS), rng.uniform(5, 15, TRACKS)])
    poses = [Pose.from_rotvec(rng.normal(0, 0.02, 3), np.array([-0.4 * i, 0.05 * i, -0.1 * i])) for i in range(VIEWS)]
    turns, shifts = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    count = rng.integers(3, VIEWS + 1, TRACKS)
    cameras = np.concatenate([rng.integers(0, VIEWS - n + 1) + np.arange(n) for n in count])
    owners = np.repeat(np.arange(TRACKS), count)
    near = np.einsum("kij,kj->ki", turns[cameras], points[owners]) + shifts[cameras]
    uv = near[:, :2] / near[:, 2:]
    off = np.concatenate([errors["new"] * rng.normal(size=(n, 2)) + _walk(rng, n, errors["step"]) for n in count])
    if cell:
        ground = points[owners, :2] / points[owners, 2:]
        key = np.floor(ground / cell).astype(int) @ [1, 1000] + 1_000_000 * cameras
        _, place = np.unique(key, return_inverse=True)
        off = errors["new"] * like.normal(size=(place.max() + 1, 2))[place]
    right = (near[:, 0] - baseline) / near[:, 2] + off[:, 0] + errors["disparity"] * rng.normal(size=len(off))
    seen = np.column_stack([uv + off, right if baseline else np.full(len(off), np.nan)])
    extra = np.zeros(PAIR if baseline else LENS)
    factors, fixed = np.zeros((len(off) if baseline else 0, len(extra))), 1 if baseline else 2
    return Window(turns, shifts, points, cameras, owners, seen, baseline, extra, extra, factors, fixed=fixed)


def _walk(rng: np.random.Generator, n: int, step: float) -> Array:
    return np.vstack([np.zeros((1, 2)), np.cumsum(step * rng.normal(size=(n - 1, 2)), axis=0)])


def found(window: Window, scale: float = 5 * SETTING) -> tuple[TrackNoise, Adjusted]:
    done = adjust(window, scale, 15)
    return TrackNoise().after(done, scale), done


@pytest.mark.parametrize("baseline", [0.0, 0.3])
@pytest.mark.parametrize(("new", "step"), [(1e-3, 0.0), (0.0, 1e-3), (6e-4, 6e-4)])
def test_new_errors_and_walks_are_told_apart(new: float, step: float, baseline: float) -> None:
    noise, _ = found(flown(0, {"new": new, "step": step, "disparity": 4e-4}, baseline))
    variances = noise.variances
    assert variances[0] == pytest.approx(new**2, rel=0.25, abs=2e-7)
    assert variances[1] == pytest.approx(step**2, rel=0.25, abs=2e-7)
    assert variances[2] == pytest.approx(4e-4**2 if baseline else 0.0, rel=0.1)
    ends = np.sqrt(new**2 + step**2 * (noise.views - 1) / 2)
    assert noise.sigma(SETTING) == pytest.approx(ends, rel=0.1)


def test_without_errors_nothing_is_left_but_what_was_believed() -> None:
    noise, _ = found(flown(1, {"new": 0.0, "step": 0.0, "disparity": 0.0}))
    assert (noise.variances < 1e-16).all() and noise.weight > 200
    assert noise.sigma(SETTING) == pytest.approx(SETTING * np.sqrt(BELIEVED / (BELIEVED + noise.weight)), rel=1e-3)
    assert TrackNoise().sigma(SETTING) == SETTING and TrackNoise().variance(SETTING) == SETTING**2


@pytest.mark.parametrize("baseline", [0.0, 0.3])
def test_two_pairs_tell_it_and_two_images_do_not(baseline: float) -> None:
    said = [found(_first_two(flown(s, {"new": 2e-3, "step": 0.0, "disparity": 4e-4}, baseline)))[0] for s in range(8)]
    if baseline:
        # The pose takes some of so few errors.
        assert np.sqrt(np.mean([n.variances @ (1, 0.5, 0) for n in said])) == pytest.approx(2e-3, rel=0.1)
        assert all(n.sigma(SETTING) > 1.4 * SETTING for n in said)
    else:
        assert all(n.sigma(SETTING) == SETTING for n in said)


def _first_two(window: Window) -> Window:
    both = np.bincount(window.owners[window.cameras < 2], minlength=TRACKS) == 2
    part = (window.cameras < 2) & both[window.owners]
    return replace(
        window,
        rotations=window.rotations[:2],
        translations=window.translations[:2],
        points=window.points[both],
        cameras=window.cameras[part],
        owners=(np.cumsum(both) - 1)[window.owners[part]],
        seen=window.seen[part],
        factors=window.factors[part] if window.baseline else window.factors,
    )


@pytest.mark.parametrize("scale", [5e-3, 1.5e-3])
@pytest.mark.parametrize(("new", "step"), [(1e-3, 0.0), (0.0, 1e-3)])
def test_the_covariance_that_follows_is_that_of_the_errors(new: float, step: float, scale: float) -> None:
    """Of the newest pose, whether a track's errors are independent or a walk, and the loss is wide or as narrow as they
    are."""
    nees = []
    for seed in range(16):
        true = flown(seed, {"new": new, "step": step, "disparity": 0.0})
        noise, done = found(true, scale)
        free = np.linalg.inv(covariance(done.window, scale))[12:-2, 12:-2]  # two poses are held
        claimed = np.linalg.inv(free)[-6:, -6:] * noise.variance(SETTING) / scale**2
        pose = Pose(done.window.rotations[-1], done.window.translations[-1])
        off = (pose @ Pose(true.rotations[-1], true.translations[-1]).inverse()).log()
        nees.append(off @ np.linalg.solve(claimed, off))
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high


def test_errors_that_neighbours_share_count_more() -> None:
    alone, _ = found(flown(2, {"new": 1e-3, "step": 0.0, "disparity": 0.0}))
    alike, _ = found(flown(2, {"new": 1e-3, "step": 0.0, "disparity": 0.0}, cell=0.2))
    assert alone.shared < 1.2 and alike.shared > 2


def test_it_follows_a_change_and_gross_errors_say_nothing() -> None:
    quiet, loud = (flown(3, {"new": e, "step": 0.0, "disparity": 0.0}) for e in (5e-4, 2e-3))
    wrong = quiet.seen.copy()
    wrong[::97] += 0.1
    kept, _ = found(quiet)
    hit, _ = found(replace(quiet, seen=wrong))
    assert hit.sigma(SETTING) == pytest.approx(kept.sigma(SETTING), rel=0.25)
    noise = kept
    for _ in range(6):
        noise = noise.after(adjust(loud, 5e-3, 15), 5e-3)
    assert noise.sigma(SETTING) == pytest.approx(2e-3, rel=0.1)
