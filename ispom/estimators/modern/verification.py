"""Whether an image shows what a keyframe saw, and from where it was taken: for lost cameras and for loops.

Descriptors are matched and a pose is fitted to the points that match. It is kept only if enough of the other features
are found where it puts them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.features.descriptors import each_once, match_near, near, on_lines
from ispom.features.interfaces import Allowed, Features, Matcher
from ispom.geometry import Array, Pose, skew
from ispom.solvers.localisation import PoseFit, refine_pose, resect

MIN_SHARE = 0.25
"""Share of the matches that must agree with a pose: fewer agree by chance."""
MAX_DEPTH_RATIO = 4.0
"""Ratio of a point's depths in both images, either way, beyond which descriptors do not match any more: a pose so far
off that all points are one agrees with anything."""
MIN_CONFIRMED = 0.1
"""Share of the features that a pose puts into the image which must be found there: a wrong pose finds 3-6 % of them by
chance, a right one 10-14 % where 20-25 m of road lie between two images of it, and more where less."""
MIN_OVER_CHANCE, CHANCE_TRIALS = 3.0, 2
"""A smaller share confirms a pose if the matches, less the few that any pose is fitted to, exceed those of chance in
the same two images by this factor; chance is measured in this number of trials. In sim:indoor chance matches 4-8 % of
the features, which leaves the decision to the share above; in photos of an object with wide steps 1 %, where right
poses find 7-10 %."""
MIN_BESIDE_DENSEST = 0.25
"""Of such a smaller share, what must lie outside the quarter of the features where most of it lies: one thing that
stands elsewhere as well is no place."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """What is known of the features of a keyframe, or of several, that an image may show again."""

    features: Features
    xyz_of: Callable[[NDArray[np.int64]], Array]
    """Points (M, 3) of these features (M,), in any world; NaN where the depth is unknown."""
    keyframe_from_world: Pose = Pose()
    """Into the camera that saw them."""
    repeated: bool = False
    """Several features may be of one point, as several keyframes show it."""


@dataclass(frozen=True, eq=False)
class View:
    """The image that is compared, by a camera whose coordinates are corrected."""

    features: Features
    normalise: Callable[[NDArray[np.int64]], Array]
    """Normalised coordinates (M, 2) of these features (M,)."""
    project: Callable[[Array], Array]
    """Coordinates (N, 2), as the features have them, of points (N, 3) in the camera; NaN for those out of its image."""


@dataclass(frozen=True, eq=False)
class Verification:
    """How many features must agree, and how well, before an image and a keyframe show one place."""

    matcher: Matcher
    limit: float
    """Largest reprojection error, normalised."""
    search: tuple[float, ...]
    """Distances around where a pose puts the features within which they are looked for, one after the other."""
    fewest_matched: int
    """Of those matched by their descriptors alone."""
    fewest: int
    """Of those found where the pose puts them."""
    solvers: tuple[Callable[[Array, Array, float], PoseFit | None], ...] = (resect,)
    """Each may end in a pose that only points close together agree with; the right one lets more be found."""
    measure_chance: bool = True
    """Let a smaller share confirm a pose, see `confirmed`."""

    def verify(self, candidate: Candidate, view: View) -> Verified | None:
        """Returns the pose by which the image shows most of the candidate's features; None where it does not."""
        pairs = self.matcher.match(candidate.features, view.features)
        if len(pairs) < self.fewest_matched:
            return None
        xyz, best = candidate.xyz_of(pairs[:, 0]), None
        known = np.isfinite(xyz[:, 0])
        xyz, x, every = xyz[known], view.normalise(pairs[known, 1]), None
        for solve in self.solvers:
            found = solve(xyz, x, self.limit)
            if found is None or _agreeing(candidate, xyz, found).sum() < self.fewest_matched:
                continue
            if every is None:
                every = candidate.xyz_of(np.arange(len(candidate.features)))
            verified = self._confirm(candidate, view, every, found.camera_from_world)
            if verified is not None and (best is None or len(verified.pairs) > len(best.pairs)):
                best = verified
        return best

    def _confirm(self, candidate: Candidate, view: View, xyz: Array, pose: Pose) -> Verified | None:
        """Looks for all features (N,) with points (N, 3) where a pose puts them, and refines it by those found."""
        then, now = candidate.features, view.features
        pairs, all_found, agreeing = np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64), np.zeros(0, bool)
        expected = xyz[:, :2]
        for distance in self.search:
            expected = view.project(pose.apply(xyz))
            all_found, similarity = self.matcher.match_where(then, now, near(expected, now.uv, distance))
            pairs = each_once(all_found, similarity)
            refined = refine_pose(xyz[pairs[:, 0]], view.normalise(pairs[:, 1]), pose, self.limit)
            if refined is None:
                return None
            pose, agreeing = refined.camera_from_world, _agreeing(candidate, xyz[pairs[:, 0]], refined)
        if agreeing.sum() < self.fewest:
            return None
        matched = all_found[:, 0] if candidate.repeated else pairs[agreeing, 0]
        chance = partial(matches_by_chance, self.matcher, then, now, expected, self.search[-1])
        if not confirmed(matched, expected, self.fewest, chance if self.measure_chance else None):
            return None
        return Verified(pose, pairs[agreeing], xyz[pairs[agreeing, 0]])


@dataclass(frozen=True, eq=False)
class Verified:
    """An image that shows what a keyframe saw."""

    camera_from_world: Pose
    """In the candidate's world."""
    pairs: NDArray[np.int64]
    """(M, 2) features of the candidate and of the image that agree with the pose."""
    xyz: Array
    """(M, 3) their points."""


def on_epipolar_lines(motion: Pose, x: Array, y: Array, distance: float) -> Allowed:
    """Allows points y (M, 2) of a second camera near the epipolar lines of points x (N, 2) of a first one.

    `motion` is second_from_first, coordinates and `distance` are normalised.
    """
    lines = np.column_stack([x, np.ones(len(x))]) @ (skew(motion.translation) @ motion.rotation).T
    lines /= np.maximum(np.hypot(*lines[:, :2].T), 1e-12)[:, None]
    return on_lines(lines, y, distance)


def _agreeing(candidate: Candidate, xyz: Array, found: PoseFit) -> NDArray[np.bool_]:
    then, now = candidate.keyframe_from_world.apply(xyz), found.camera_from_world.apply(xyz)
    return plausible(found.inliers, then[:, 2], now[:, 2])


def plausible(agreeing: NDArray[np.bool_], depth_before: Array, depth_now: Array) -> NDArray[np.bool_]:
    """Which (N,) of the points that agree with a pose can do so, with their depths (N,) in both images: none where
    they are too small a share."""
    ratio = depth_now / np.maximum(depth_before, 1e-9)
    good = agreeing & (ratio < MAX_DEPTH_RATIO) & (ratio > 1 / MAX_DEPTH_RATIO)
    return good if good.mean() >= MIN_SHARE else np.zeros(len(good), bool)


def confirmed(
    matched: NDArray[np.int64], expected: Array, fewest: int, chance: Callable[[], float] | None = None
) -> bool:
    """Whether enough features are found where a pose expects them.

    `expected` (N, 2) [px] is where the pose puts the features, NaN where it puts them out of the image; `matched` (M,)
    are those found there. A share of them is enough; a smaller one where it is far more than `chance`, the number that
    a wrong pose would match, and is not one thing that may stand elsewhere as well.
    """
    if len(matched) < fewest:
        return False
    if len(matched) >= MIN_CONFIRMED * np.isfinite(expected[:, 0]).sum():
        return True
    if chance is None or _share_beside_densest(matched, expected) < MIN_BESIDE_DENSEST:
        return False
    return len(matched) >= fewest + MIN_OVER_CHANCE * chance()


def matches_by_chance(matcher: Matcher, then: Features, now: Features, expected: Array, distance_px: float) -> float:
    """How many features would be matched if each were expected where another one is: what a wrong pose would match."""
    inside, rng, found = np.flatnonzero(np.isfinite(expected[:, 0])), np.random.default_rng(0), list[int]()
    for _ in range(CHANCE_TRIALS):
        elsewhere = np.full_like(expected, np.nan)
        elsewhere[inside] = expected[rng.permutation(inside)]
        found.append(len(match_near(matcher, then, now, elsewhere, distance_px)))
    return float(np.mean(found))


def _share_beside_densest(matched: NDArray[np.int64], expected: Array) -> float:
    """The share of the matches outside the densest quarter of the image, of 4 x 4 cells of as many features each."""
    inside = np.flatnonzero(np.isfinite(expected[:, 0]))
    column, cell = np.zeros(len(expected), int), np.zeros(len(expected), int)
    column[inside] = _quarters(expected[inside, 0])
    for i in range(4):
        own = inside[column[inside] == i]
        cell[own] = 4 * i + _quarters(expected[own, 1])
    counts = np.sort(np.bincount(cell[matched], minlength=16))
    return float(counts[:12].sum() / max(counts.sum(), 1))


def _quarters(values: Array) -> NDArray[np.int64]:
    """(N,) 0 for the least quarter of the values to 3 for the greatest."""
    return 4 * np.argsort(np.argsort(values, kind="stable"), kind="stable") // max(len(values), 1)
