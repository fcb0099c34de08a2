"""The optimisation of the window: bundle adjustment, covariance and marginalisation, for a global shutter.

For a rolling shutter see rolling_window.py.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.stereo.pair import Setup
from ispom.estimators.modern.stereo.state import KeyFrame, StereoMap
from ispom.geometry import Array, Pose
from ispom.kernels import kernel
from ispom.numerics.places import places
from ispom.numerics.vectors import matrix, plus, times, vector
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.window import WindowProblem
from ispom.solvers.right_camera import BOTH_K1, BOTH_K2, COLUMNS, LAG, drift_of, fill_ideal_column, lens_removed
from ispom.solvers.window.adjustment import Adjusted, adjust, marginalise
from ispom.solvers.window.covariance import WindowCovariance
from ispom.solvers.window.prior import Sandwich
from ispom.solvers.window.problem import Window

KEPT_FRAMES = 2
"""Number of newest keyframes whose observations of a point stay when its older ones are marginalised."""


def optimised(setup: Setup, world: StereoMap) -> tuple[StereoMap, Adjusted | None]:
    """Optimises the window by bundle adjustment, and drops observations with errors above `setup.limit` afterwards.

    Covariances are computed for a global shutter only. The result is None, and the map unchanged, without two
    keyframes that observe a common point.
    """
    window, used, origin = packed(setup, world)
    if len(world.keys) < 2 or not len(window.cameras):
        return world, None
    start, result = window, adjust(window, setup.noise.width, setup.iterations)
    window = result.window
    times_ns = tuple(key.time_ns for key in world.keys)
    if not setup.rolls:
        report_problem(lambda: WindowProblem(start, window, setup.noise.width, world.ids[used], times_ns, "left"))
    keys = [
        replace(key, left_from_world=Pose(r, t))
        for key, r, t in zip(world.keys, _proper(window.rotations), window.translations, strict=True)
    ]
    bad = result.distances > setup.limit
    for c in np.flatnonzero(np.bincount(window.cameras[bad])):
        keep = np.ones(len(keys[c].ids), bool)
        keep[origin[bad & (window.cameras == c)]] = False
        keys[c] = keys[c].only(keep)
    xyz = world.xyz.copy()
    xyz[used] = window.points
    noise = world.noise.after(result, setup.noise.width)
    moved = replace(world, keys=tuple(keys), xyz=xyz, extra=window.extra, noise=noise)
    if setup.rolls:
        return moved, result
    found = WindowCovariance.of(window, world.ids[used], setup.noise.width)
    return replace(moved, covariance=found.inverse, newest=found.newest), result


def split_at_oldest(world: StereoMap) -> tuple[tuple[KeyFrame, ...], tuple[KeyFrame, ...]]:
    """Splits the window for marginalisation of its oldest keyframe.

    Returns all keyframes with the observations to marginalise (of the oldest keyframe's points), and the others with
    the rest. Continuing tracks keep their newest observations.
    """
    oldest, newest = world.keys[0], len(world.keys) - KEPT_FRAMES
    gone = [
        places(oldest.ids, k.ids) >= 0 if i < newest else np.zeros(len(k.ids), bool) for i, k in enumerate(world.keys)
    ]
    past = tuple(k.only(m) for k, m in zip(world.keys, gone, strict=True))
    rest = (k.only(~m) for k, m in zip(world.keys[1:newest], gone[1:], strict=False))
    return past, (*rest, *world.keys[newest:])


def without_oldest(setup: Setup, world: StereoMap) -> StereoMap:
    """Marginalises the oldest keyframe and its points into a prior on the others."""
    (past, keys), covariance = split_at_oldest(world), required(world.covariance, "the window was not optimised")
    window, used, _ = packed(setup, replace(world, keys=past))
    continuing = np.concatenate([k.ids for k in keys])

    def sandwich_of(part: Window) -> Sandwich:
        return WindowCovariance.of(part, world.ids[used], setup.noise.width).marginal(continuing, covariance)

    prior = marginalise(window, np.ones(len(window.points), bool), setup.noise.width, sandwich_of)
    return replace(world, keys=keys, prior=prior)


def with_frame_covariance(setup: Setup, world: StereoMap, key: KeyFrame) -> StereoMap:
    """Returns the map with the covariance of a frame that is no keyframe, as if it were the newest one.

    A track's errors in window and frame are correlated: the sum of the covariances of the newest keyframe and of the
    relative pose would be a tenth to a third too small.
    """
    families = setup.families(world)  # not of this frame, which was localised without them
    world = replace(world, keys=(*world.keys, key.only(world.places(key.ids) >= 0)))
    window, used, _ = packed(setup, world)
    window = replace(window, families=families)
    return replace(world, newest=WindowCovariance.of(window, world.ids[used], setup.noise.width).newest)


def packed(setup: Setup, world: StereoMap) -> tuple[Window, NDArray[np.int64], NDArray[np.int64]]:
    """Returns the window's arrays, the indices of its points in the map, and of each observation in its keyframe."""
    keys, baseline = world.keys, float(setup.baseline_m)
    rotations = np.stack([k.left_from_world.rotation for k in keys])
    translations = np.stack([k.left_from_world.translation for k in keys])
    arrays = pack(
        world.ids,
        world.xyz,
        np.concatenate([k.ids for k in keys]),
        np.array([len(k.ids) for k in keys]),
        np.concatenate([k.at_middle(baseline) for k in keys]),
        rotations,
        translations,
        np.stack([k.rate for k in keys]),
        world.extra,
        baseline,
    )
    window = Window(
        rotations,
        translations,
        world.xyz[arrays.used],
        arrays.cameras,
        arrays.owners,
        arrays.seen,
        baseline,
        world.extra,
        setup.extra_sigma,
        arrays.factors,
        world.prior,
        families=setup.families(world),
    )
    return window, arrays.used, arrays.origin


def _proper(rotations: Array) -> Array:
    """Returns the nearest rotations (C, 3, 3), as products of many rotations accumulate rounding errors."""
    u, _, vt = np.linalg.svd(rotations)
    return u @ vt


class Packed(NamedTuple):
    """The K observations of the M points that at least two keyframes observe. A point that is observed once has as many
    unknowns as observations with a disparity, so it constrains nothing."""

    used: NDArray[np.int64]
    """(M,) indices of the points in the map, ascending."""
    cameras: NDArray[np.int64]
    """(K,) keyframe of each observation; sorted by point, those of a point by keyframe."""
    owners: NDArray[np.int64]
    """(K,) index of each observation's point in `used`."""
    origin: NDArray[np.int64]
    """(K,) index of each observation in its keyframe."""
    seen: Array
    """(K, 3) see KeyFrame.seen."""
    factors: Array
    """(K, COLUMNS) see right_camera.by_column."""


@kernel()
def pack(known, xyz, ids, sizes, seen, rotations, translations, rates, extra, baseline):
    """Sorts the observations by point. The map has points `known` (P,), ascending, at `xyz` (P, 3). Keyframes have
    `sizes` (C,) observations: `ids` (N,), ascending in each, and `seen` (N, 3); poses `rotations` (C, 3, 3) and
    `translations` (C, 3); and `rates` (C, 6). `extra` (E,) are the corrections of the pair."""
    place, count = np.full(len(ids), -1), np.zeros(len(known), np.int64)
    begin = 0
    for c in range(len(sizes)):
        p = 0
        for i in range(begin, begin + sizes[c]):
            while p < len(known) and known[p] < ids[i]:
                p += 1
            if p < len(known) and known[p] == ids[i]:
                place[i] = p
                count[p] += 1
        begin += sizes[c]
    # index of the first observation of each point
    first, owner, total, points = np.full(len(known), -1), np.empty(len(known), np.int64), 0, 0
    for p in range(len(known)):
        if count[p] >= 2:
            first[p], owner[p] = total, points
            total += count[p]
            points += 1
    out = Packed(
        np.empty(points, np.int64), np.empty(total, np.int64), np.empty(total, np.int64), np.empty(total, np.int64),
        np.empty((total, 3)), np.zeros((total, COLUMNS)),
    )  # fmt: skip
    begin = 0
    for c in range(len(sizes)):
        for i in range(begin, begin + sizes[c]):
            p = place[i]
            if p < 0 or first[p] < 0:
                continue
            k = first[p]
            first[p] += 1
            out.used[owner[p]], out.owners[k], out.cameras[k], out.origin[k] = p, owner[p], c, i - begin
            near = plus(times(matrix(rotations, c), vector(xyz, p)), vector(translations, c))
            late = drift_of(near, rates, c, extra[LAG], baseline)
            x, y, right = vector(seen, i)
            out.seen[k, 0], out.seen[k, 1], out.seen[k, 2] = x, y, right
            x, y = lens_removed(x, y, extra[BOTH_K1], extra[BOTH_K2])
            fill_ideal_column(out.factors, k, x, y, right, extra, late[0])
        begin += sizes[c]
    return out
