"""Trials: how candidates for recognition were examined, with their rules, matches and relative poses.

Loops, joins of segments and relocalisations compare an image with earlier keyframes. Each rule reports its value here.
In a normal run nobody collects these reports; results of a step are the same with and without collection.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Similarity
from ispom.types import Check, Decision, FrameName

TrialKind = Literal["loop", "join", "relocalisation"]


def _rule(key: str, name: str, passes: str, fails: str, relation: Literal[">=", "<="] = ">=", unit: str = "") -> Check:
    return Check(f"candidate_{key}", name, "finding", "Seen before?", relation, unit, passes, fails)


REACH = _rule(
    "reach",
    "distance from the earlier keyframe by odometry",
    "The odometry may have drifted to this keyframe.",
    "The odometry cannot have drifted to this keyframe: it is {value} away ({threshold} at most).",
    "<=",
)
RANK = _rule(
    "rank",
    "rank by similarity of appearance",
    "It is number {value} by appearance ({threshold} are compared).",
    "{value} keyframes look at least as similar ({threshold} are compared).",
    "<=",
)
TURN = _rule(
    "turn",
    "place in the order of comparison",
    "It was compared.",
    "It was not compared: number {value} by appearance, and the comparison ended after {threshold}.",
    "<=",
)
MATCHES = _rule(
    "matches",
    "matched descriptors",
    "{value} descriptors match ({threshold} needed).",
    "Only {value} descriptors match ({threshold} needed).",
)
POSE = _rule(
    "pose",
    "matches that agree on one pose",
    "{value} matches agree on a pose ({threshold} needed).",
    "Only {value} matches agree on a pose ({threshold} needed).",
)
FOUND = _rule(
    "found",
    "points found at their projections",
    "{value} points are where that pose projects them ({threshold} needed).",
    "Only {value} points are where that pose projects them ({threshold} needed).",
)
SHARE = _rule(
    "share",
    "share of the projected points that are found",
    "{value:.0%} of the projected points are found ({threshold:.0%} suffice).",
    "Only {value:.0%} of the projected points are found ({threshold:.0%} needed).",
)
DEPTHS = _rule(
    "depths",
    "points whose depth is confirmed",
    "{value} depths are confirmed by other keyframes ({threshold} needed).",
    "Only {value} depths are confirmed by other keyframes ({threshold} needed).",
)
POINTS = _rule(
    "points",
    "points that fit the relative pose",
    "{value} points fit the relative pose ({threshold} needed).",
    "Only {value} points fit the relative pose ({threshold} needed).",
)
APART = _rule(
    "apart",
    "distance of both keyframes, in scene depths",
    "The keyframes are {value:.2f} scene depths apart ({threshold} at most).",
    "The keyframes are {value:.2f} scene depths apart ({threshold} at most).",
    "<=",
)
SCALES = _rule(
    "scales",
    "points with a depth in both keyframes",
    "{value} points have a depth in both keyframes ({threshold} needed).",
    "Only {value} points have a depth in both keyframes ({threshold} needed).",
)
DRIFT = _rule(
    "drift",
    "drift of the position that it requires",
    "It requires a drift of {value} ({threshold} is possible).",
    "It requires a drift of {value}, and only {threshold} is possible.",
    "<=",
)
DRIFT_TURN = _rule(
    "drift_turn",
    "drift of the orientation that it requires",
    "It requires a drift of {value} degrees ({threshold} is possible).",
    "It requires a drift of {value} degrees, and only {threshold} is possible.",
    "<=",
    "deg",
)
DRIFT_SCALE = _rule(
    "drift_scale",
    "drift of ln scale that it requires",
    "It requires a drift of ln scale of {value:.2f} ({threshold} is possible).",
    "It requires a drift of ln scale of {value:.2f}, and only {threshold} is possible.",
    "<=",
)
BEST = _rule(
    "best",
    "points, compared with the best candidate of this image",
    "No other candidate of this image has more points ({value}).",
    "Another candidate of this image has more points ({value}, and {threshold}).",
)
LOCALISED = _rule(
    "localised",
    "points by which the image is localised at the keyframe",
    "The image is localised by {value} points ({threshold} needed).",
    "The image is localised by {value} points only ({threshold} needed).",
)
BETTER = _rule(
    "better",
    "points, compared with tracking alone",
    "Tracking alone has fewer points, or contradicts nothing.",
    "Tracking alone has as many points, or contradicts it ({value} points, {threshold} tracked).",
)
RULES = (
    REACH,
    RANK,
    TURN,
    MATCHES,
    POSE,
    FOUND,
    SHARE,
    DEPTHS,
    POINTS,
    APART,
    SCALES,
    DRIFT,
    DRIFT_TURN,
    DRIFT_SCALE,
    BEST,
    LOCALISED,
    BETTER,
)
"""Rules that are in no Step. Candidates must also pass checks of Steps, such as loop_views."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched features of both images, normalised coordinates without distortion."""

    first: Array
    """(M, 2) in the earlier image; points of its neighbours are where it would see them, NaN behind it."""
    then: Array
    """(M, 2) in the later image."""
    inlier: NDArray[np.bool_]
    """(M,) whether a match fits the pose."""


@dataclass(frozen=True, eq=False)
class RelativePoseFound:
    """The relative pose that was measured with a candidate."""

    first_from_then: Similarity
    """Relative pose in the unit of the earlier keyframe."""
    covariance: Array | None
    """(7, 7) covariance of its right perturbation (rho, phi, ln scale); None where it is not estimated."""
    depth: float
    """Median depth of the common points, in the unit of the earlier keyframe; NaN if unknown."""


@dataclass(eq=False)
class Trial:
    """The rules and results of one candidate in one frame."""

    kind: TrialKind
    camera: FrameName
    first_ns: int
    """Time of the earlier keyframe. A lost frame is tried again later: then it may be a later one."""
    then_ns: int
    """Time of the image that is compared with it."""
    rules: dict[str, Decision] = field(default_factory=dict)
    """By key, in the order in which they were applied."""
    matches: Matches | None = None
    pose: RelativePoseFound | None = None
    accepted: bool = False
    _pairs: NDArray[np.int64] | None = None
    _inliers: NDArray[np.int64] | None = None

    @property
    def key(self) -> tuple[TrialKind, FrameName, int, int]:
        return self.kind, self.camera, self.first_ns, self.then_ns

    def update(self, later: Trial) -> None:
        """Adds the results of a later frame about the same candidate."""
        self.rules |= later.rules
        self.matches, self.pose = later.matches or self.matches, later.pose or self.pose
        self.accepted |= later.accepted


@dataclass(frozen=True, eq=False)
class _Collected:
    trials: dict[tuple[TrialKind, FrameName, int, int], Trial] = field(default_factory=dict)


_collected: ContextVar[_Collected | None] = ContextVar("ispom_trials", default=None)
_current: ContextVar[Trial | None] = ContextVar("ispom_trial", default=None)


@contextmanager
def collecting_trials() -> Iterator[Mapping[tuple[TrialKind, FrameName, int, int], Trial]]:
    """Collects the trials of the candidates compared in this context, in this thread."""
    collected = _Collected()
    token = _collected.set(collected)
    try:
        yield collected.trials
    finally:
        _collected.reset(token)


def is_collecting() -> bool:
    """Returns whether reports are collected. Values that take time are computed only then."""
    return _collected.get() is not None


@contextmanager
def trial(kind: TrialKind, camera: FrameName, first_ns: int, then_ns: int) -> Iterator[None]:
    """In this context, reports are about this candidate."""
    if (collected := _collected.get()) is None:
        yield
        return
    new = Trial(kind, camera, first_ns, then_ns)
    token = _current.set(collected.trials.setdefault(new.key, new))
    try:
        yield
    finally:
        _current.reset(token)


def judged(passed: bool, rule: Check, value: float, threshold: float) -> bool:
    """Reports the outcome of a rule for the current candidate, and returns `passed`. Of several attempts with one
    candidate, such as those of several solvers, the one that passed counts."""
    if (current := _current.get()) is not None:
        before = current.rules.get(rule.key)
        if passed or before is None or not before.passed:
            current.rules[rule.key] = rule.of(value, threshold, passed=bool(passed))
    return bool(passed)


def report_decision(decision: Decision) -> None:
    """Reports a check of the Step for the current candidate."""
    if (current := _current.get()) is not None:
        current.rules[decision.key] = decision


def report_pairs(pairs: NDArray[np.int64]) -> None:
    """Reports the matches (M, 2), as indices of the features of both images."""
    if (current := _current.get()) is not None:
        current._pairs = pairs


def report_inliers(pairs: NDArray[np.int64]) -> None:
    """Reports those matches (M, 2) that fit the pose."""
    if (current := _current.get()) is not None and (current._inliers is None or len(pairs) > len(current._inliers)):
        current._inliers = pairs


def report_positions(first: Array, then: Array) -> None:
    """Reports the normalised coordinates (N, 2), (M, 2) of the features of both images; NaN where there are none."""
    current = _current.get()
    if current is None or current._pairs is None:
        return
    inliers = np.zeros((0, 2), np.int64) if current._inliers is None else current._inliers
    kept = set(map(tuple, inliers.tolist()))
    others = [pair for pair in current._pairs.tolist() if tuple(pair) not in kept]
    pairs = np.array([*inliers.tolist(), *others], np.int64).reshape(-1, 2)
    inlier = np.arange(len(pairs)) < len(inliers)
    current.matches = Matches(first[pairs[:, 0]].astype(float), then[pairs[:, 1]].astype(float), inlier)


def report_pose(first_from_then: Similarity, covariance: Array | None, depth: float) -> None:
    """Reports the relative pose of the current candidate, see RelativePoseFound."""
    if (current := _current.get()) is not None:
        current.pose = RelativePoseFound(first_from_then, covariance, float(depth))


def report_accepted() -> None:
    """Reports that the current candidate is accepted."""
    if (current := _current.get()) is not None:
        current.accepted = True
