"""Verifies that an image shows the scene of a keyframe, and estimates its pose: for relocalisation and for loops.

Descriptors are matched and a pose is fitted to the matches. The pose is accepted only if enough of the other features
are found at their projections.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern import trials
from ispom.estimators.modern.trials import judged
from ispom.features.descriptors import each_once, match_near, near, on_lines
from ispom.features.interfaces import Allowed, Features, Matcher
from ispom.geometry import Array, Pose, skew
from ispom.solvers.localisation import PoseFit, refine_pose, resect

MIN_SHARE = 0.25
"""Least share of inliers among the matches: a smaller share occurs by chance."""
MAX_DEPTH_RATIO = 4.0
"""Largest ratio of a point's depths in both images, either way. Descriptors do not match beyond it, and a pose so
distant that all points coincide fits anything."""
MIN_CONFIRMED = 0.1
"""Least share of the projected features that must be found: a wrong pose finds 3-6 % of them by chance, a right one
10-14 % where 20-25 m of road lie between the two images, and more where less."""
MIN_OVER_CHANCE, CHANCE_TRIALS = 3.0, 2
"""Smaller shares confirm a pose if the matches, less the few that any pose is fitted to, exceed the chance matches of
the same two images by this factor; chance is measured in this number of trials. In sim:indoor 4-8 % of the features
match by chance, which leaves the decision to the share above; in photos of an object with wide steps it is 1 %, where
right poses find 7-10 %."""
MIN_BESIDE_DENSEST = 0.25
"""For such a smaller share: least share of the matches outside the densest quarter of the features. A single object,
which may also stand elsewhere, does not identify the scene."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Features of a keyframe, or of several, that may be visible in an image."""

    features: Features
    xyz_of: Callable[[NDArray[np.int64]], Array]
    """Returns the points (M, 3) of these features (M,), in any world; NaN where the depth is unknown."""
    keyframe_from_world: Pose = Pose()
    """Pose of the camera that observed them."""
    repeated: bool = False
    """Whether several features may belong to one point, as several keyframes show it."""


@dataclass(frozen=True, eq=False)
class View:
    """The image to compare, with a calibrated camera."""

    features: Features
    normalise: Callable[[NDArray[np.int64]], Array]
    """Returns the normalised coordinates (M, 2) of these features (M,)."""
    project: Callable[[Array], Array]
    """Returns the coordinates (N, 2), in the units of the features, of points (N, 3) in the camera; NaN outside of the
    image."""


@dataclass(frozen=True, eq=False)
class Verification:
    """Verifies an image against keyframes, with these thresholds."""

    matcher: Matcher
    limit: float
    """Largest reprojection error, normalised."""
    search: tuple[float, ...]
    """Radii, in the units of the features, of the successive searches around the projected features."""
    fewest_matched: int
    """Least number of inliers among the descriptor matches."""
    fewest: int
    """Least number of inliers among the features found at their projections."""
    solvers: tuple[Callable[[Array, Array, float], PoseFit | None], ...] = (resect,)
    """Solvers to try: each may end in a pose that fits only points close together. The pose with the most matches is
    used."""
    measure_chance: bool = True
    """Whether a smaller share may confirm a pose, see `confirmed`."""

    def verify(self, candidate: Candidate, view: View) -> Verified | None:
        """Returns the pose with which most of the candidate's features are found in the image; None if it does not
        match."""
        pairs = self.matcher.match(candidate.features, view.features)
        trials.report_pairs(pairs)
        if not judged(len(pairs) >= self.fewest_matched, trials.MATCHES, len(pairs), self.fewest_matched):
            return None
        xyz, best = candidate.xyz_of(pairs[:, 0]), None
        known = np.isfinite(xyz[:, 0])
        xyz, x, every = xyz[known], view.normalise(pairs[known, 1]), None
        for solve in self.solvers:
            found = solve(xyz, x, self.limit)
            agreeing = 0 if found is None else int(_agreeing(candidate, xyz, found).sum())
            enough = judged(agreeing >= self.fewest_matched, trials.POSE, agreeing, self.fewest_matched)
            if found is None or not enough:
                continue
            if every is None:
                every = candidate.xyz_of(np.arange(len(candidate.features)))
            verified = self._confirm(candidate, view, every, found.camera_from_world)
            if verified is not None and (best is None or len(verified.pairs) > len(best.pairs)):
                best = verified
        return best

    def _confirm(self, candidate: Candidate, view: View, xyz: Array, pose: Pose) -> Verified | None:
        """Searches all features (N,) with points (N, 3) at their projections, and refines the pose with those found."""
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
        trials.report_inliers(pairs[agreeing])
        if not judged(agreeing.sum() >= self.fewest, trials.FOUND, agreeing.sum(), self.fewest):
            return None
        matched = all_found[:, 0] if candidate.repeated else pairs[agreeing, 0]
        chance = partial(matches_by_chance, self.matcher, then, now, expected, self.search[-1])
        share = len(matched) / max(int(np.isfinite(expected[:, 0]).sum()), 1)
        good = confirmed(matched, expected, self.fewest, chance if self.measure_chance else None)
        if not judged(good, trials.SHARE, share, MIN_CONFIRMED):
            return None
        return Verified(pose, pairs[agreeing], xyz[pairs[agreeing, 0]])


@dataclass(frozen=True, eq=False)
class Verified:
    """The verified pose of an image relative to a candidate."""

    camera_from_world: Pose
    """The pose in the candidate's world."""
    pairs: NDArray[np.int64]
    """(M, 2) inliers: indices of features of the candidate and of the image."""
    xyz: Array
    """(M, 3) their points."""


def on_epipolar_lines(motion: Pose, x: Array, y: Array, distance: float) -> Allowed:
    """Allows matches of points y (M, 2) of a second camera near the epipolar lines of points x (N, 2) of a first one.

    `motion` is second_from_first; coordinates and `distance` are normalised.
    """
    lines = np.column_stack([x, np.ones(len(x))]) @ (skew(motion.translation) @ motion.rotation).T
    lines /= np.maximum(np.hypot(*lines[:, :2].T), 1e-12)[:, None]
    return on_lines(lines, y, distance)


def _agreeing(candidate: Candidate, xyz: Array, found: PoseFit) -> NDArray[np.bool_]:
    then, now = candidate.keyframe_from_world.apply(xyz), found.camera_from_world.apply(xyz)
    return plausible(found.inliers, then[:, 2], now[:, 2])


def plausible(agreeing: NDArray[np.bool_], depth_before: Array, depth_now: Array) -> NDArray[np.bool_]:
    """Returns which inliers (N,) have plausible depths (N,) in both images; none if their share is below MIN_SHARE."""
    ratio = depth_now / np.maximum(depth_before, 1e-9)
    good = agreeing & (ratio < MAX_DEPTH_RATIO) & (ratio > 1 / MAX_DEPTH_RATIO)
    return good if good.mean() >= MIN_SHARE else np.zeros(len(good), bool)


def confirmed(
    matched: NDArray[np.int64], expected: Array, fewest: int, chance: Callable[[], float] | None = None
) -> bool:
    """Checks that enough features are found at their projections.

    `expected` (N, 2) [px] are the projections, NaN outside of the image; `matched` (M,) are the features found there. A
    share of MIN_CONFIRMED passes. A smaller one passes if it clearly exceeds `chance`, the number of matches of a wrong
    pose, and does not come from a single object.
    """
    if len(matched) < fewest:
        return False
    if len(matched) >= MIN_CONFIRMED * np.isfinite(expected[:, 0]).sum():
        return True
    if chance is None or _share_beside_densest(matched, expected) < MIN_BESIDE_DENSEST:
        return False
    return len(matched) >= fewest + MIN_OVER_CHANCE * chance()


def matches_by_chance(matcher: Matcher, then: Features, now: Features, expected: Array, distance_px: float) -> float:
    """Counts the matches when each feature is expected at the projection of another one, as for a wrong pose."""
    inside, rng, found = np.flatnonzero(np.isfinite(expected[:, 0])), np.random.default_rng(0), list[int]()
    for _ in range(CHANCE_TRIALS):
        elsewhere = np.full_like(expected, np.nan)
        elsewhere[inside] = expected[rng.permutation(inside)]
        found.append(len(match_near(matcher, then, now, elsewhere, distance_px)))
    return float(np.mean(found))


def _share_beside_densest(matched: NDArray[np.int64], expected: Array) -> float:
    """Returns the share of the matches outside the densest quarter of the image, of 4 x 4 cells with equally many
    features."""
    inside = np.flatnonzero(np.isfinite(expected[:, 0]))
    column, cell = np.zeros(len(expected), int), np.zeros(len(expected), int)
    column[inside] = _quarters(expected[inside, 0])
    for i in range(4):
        own = inside[column[inside] == i]
        cell[own] = 4 * i + _quarters(expected[own, 1])
    counts = np.sort(np.bincount(cell[matched], minlength=16))
    return float(counts[:12].sum() / max(counts.sum(), 1))


def _quarters(values: Array) -> NDArray[np.int64]:
    """Returns the quartile (N,) of each value, from 0 for the smallest to 3."""
    return 4 * np.argsort(np.argsort(values, kind="stable"), kind="stable") // max(len(values), 1)
