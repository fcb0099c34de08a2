"""The first map of one camera, for the methods `hybrid.monocular` and `direct.monocular`.

Corners are followed by Lucas-Kanade until they moved enough, besides what a rotation explains. Each relative pose that
two images allow (essential matrix, and the decompositions of a homography, for a plane) is adjusted together with
images between them; the one that explains most corners counts, if these are enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.survey.common import tracks_between
from ispom.features.klt import Klt
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Array, Pose
from ispom.solvers.bundle import adjust
from ispom.solvers.localisation import fit_pose
from ispom.solvers.multiview.rotation import dominant_rotation, median_displacement
from ispom.solvers.multiview.triangulation import triangulate
from ispom.solvers.multiview.two_view import hypotheses
from ispom.types import Camera, Check, Decision, Image, Tracks, TrackStatus, by_key

FOLLOW = Klt(levels=4)
"""Tracker of corners without a depth."""
MIN_DISTANCE_PX = 10.0
"""Least distance between corners."""
BETWEEN = 4
"""Images between the two of the first map that help to choose its relative pose."""
LEAST_SHARE = 0.6
"""Share of the corners that the first map must explain."""
LOSS_PX = 0.5
"""Width of the robust loss in adjustments: the deviation of an aligned corner is about half of it."""
NEW_POINT_PX = 1.0
"""Largest reprojection error of a new point in both of its images."""

STARTED = Check(
    "start_parallax", "displacement of the corners that no rotation explains", "requirement", "First map?",
    unit="% of the width",
    passes="First map is tried: the corners moved by {value:.1f} % of the width ({threshold} % needed).",
    fails="Waiting for a first map: the corners moved by {value:.1f} % of the width ({threshold} % needed).",
)  # fmt: skip
EXPLAINED = Check(
    "start_explained", "share of the corners that the first map explains", "requirement", "First map?", topic="map",
    passes="First map: it explains {value:.0%} of the corners ({threshold:.0%} needed).",
    fails="No first map: it would explain {value:.0%} of the corners ({threshold:.0%} needed).",
)  # fmt: skip
CHECKS = by_key(STARTED, EXPLAINED)
STAGE = "Follows corners until two images and those between them give a map."


@dataclass(frozen=True, eq=False)
class Start:
    """N corners that are followed until there is a map."""

    first: Image
    grey: Image
    """The last image."""
    ids: NDArray[np.int64]
    first_uv: NDArray[np.float32]
    uv: NDArray[np.float32]
    next_id: int
    base: Pose = field(default_factory=Pose)
    """world_from_camera of the first image."""
    restarted: bool = False
    between: tuple[NDArray[np.float32], ...] = ()
    """(N, 2) each, in images between, oldest first."""
    skipped: int = 0
    """Images since the newest of them, of every `stride` of which one is kept."""
    stride: int = 1


class FirstMap(NamedTuple):
    """Two images and the M corners that they explain, in an arbitrary unit."""

    start: Start
    """The start with its N corners; its last image is the second one."""
    second_from_first: Pose
    xyz: Array
    """(N, 3) in the first camera; only those in `keep` are valid."""
    keep: NDArray[np.bool_]
    """(N,) whether the two images and those between them explain the corner."""


class Followed(NamedTuple):
    """The result of following corners into one image."""

    start: Start
    decisions: tuple[Decision, ...]
    tracks: Tracks
    """Tracks for display."""
    made: FirstMap | None = None


@dataclass(frozen=True)
class FirstMaps:
    """Looks for a first map; `start_moved` [% of the width] is the motion of the corners that one needs."""

    camera: Camera
    max_points: int
    min_inliers: int
    start_moved: float

    def begun(self, grey: Image, next_id: int, base: Pose | None = None, restarted: bool = False) -> Start:
        """Returns a start at an image, whose world_from_camera is `base`."""
        uv = detect_spread(grey, self.max_points, np.zeros((0, 2), np.float32), MIN_DISTANCE_PX)
        ids = next_id + np.arange(len(uv))
        return Start(grey, grey, ids, uv, uv, next_id + len(uv), base or Pose(), restarted)

    def followed(self, start: Start | None, grey: Image) -> Followed:
        """Follows the corners of the start into an image, and tries to make a map; without enough corners, or without
        a start, it begins there."""
        if start is None or len(start.ids) < 2 * self.min_inliers:
            base, restarted = (Pose(), False) if start is None else (start.base, start.restarted)
            start = self.begun(grey, 0 if start is None else start.next_id, base, restarted)
            return Followed(start, (STARTED.of(0, self.start_moved),), tracks_between(start.ids, start.uv))
        uv, status = FOLLOW.track(start.grey, grey, start.uv)
        alive = status == TrackStatus.ALIVE
        before, between = start.uv[alive], [b[alive] for b in start.between]
        start = replace(start, grey=grey, ids=start.ids[alive], first_uv=start.first_uv[alive], uv=uv[alive])
        x1, x2 = (self.camera.normalise(p.astype(float)) for p in (start.first_uv, start.uv))
        moved = 0.0
        if len(x1) >= self.min_inliers:
            rotation = dominant_rotation(x1, x2, 3 * LOSS_PX / self.camera.fx)
            moved = 100 * median_displacement(rotation, x1, x2) * self.camera.fx / grey.shape[1]
        enough = STARTED.of(moved, self.start_moved)
        decisions, made = (enough,), None
        if enough.passed:
            made, explained = self._made(start, between, x1, x2)
            decisions = (enough, explained)
        if start.skipped + 1 >= start.stride:
            between, start = [*between, start.uv], replace(start, skipped=0)
        else:
            start = replace(start, skipped=start.skipped + 1)
        if len(between) > 2 * BETWEEN:
            between, start = between[1::2], replace(start, stride=2 * start.stride)
        start = replace(start, between=tuple(between))
        return Followed(start, decisions, tracks_between(start.ids, start.uv, before), made)

    def _made(
        self, start: Start, between: list[NDArray[np.float32]], x1: Array, x2: Array
    ) -> tuple[FirstMap | None, Decision]:
        """Returns the map of the best relative pose of two images, adjusted together with some between them."""
        some = between[:: max(1, -(-len(between) // BETWEEN))]
        x = [x1, x2, *(self.camera.normalise(uv.astype(float)) for uv in some)]
        limit = NEW_POINT_PX / self.camera.fx
        trials = [self._trial(x, pose, limit) for pose in hypotheses(x1, x2, limit).second_from_first]
        good = [trial for trial in trials if trial is not None]
        if not good:
            return None, EXPLAINED.of(0.0, LEAST_SHARE)
        poses, xyz, keep = max(good, key=lambda trial: int(trial[2].sum()))
        explained = EXPLAINED.of(keep.mean(), LEAST_SHARE)
        if not explained.passed or keep.sum() < self.min_inliers:
            return None, replace(explained, passed=False)
        return FirstMap(start, poses[1], xyz, keep), explained

    def _trial(self, x: list[Array], second_from_first: Pose, limit: float) -> tuple | None:
        """Returns poses camera_from_first, points (N, 3), and which (N,) all images explain; None without a map."""
        xyz = triangulate(second_from_first, x[0], x[1])
        ahead = (xyz[:, 2] > 0) & (second_from_first.apply(xyz)[:, 2] > 0) & np.isfinite(xyz).all(axis=1)
        if ahead.sum() < self.min_inliers:
            return None
        poses = [Pose(), second_from_first]
        for i, seen in enumerate(x[2:]):
            share = (i + 1) / (len(x) - 1)
            guess = Pose.exp(share * second_from_first.log())
            fit = fit_pose(xyz[ahead], seen[ahead], guess, limit / 2, 4 * limit)
            if fit is None:
                return None
            poses.append(fit.camera_from_world)
        index, cameras = np.flatnonzero(ahead), np.arange(len(x))
        bundle = adjust(
            tuple(poses), xyz[ahead], np.tile(cameras, len(index)), np.repeat(np.arange(len(index)), len(x)),
            np.stack([seen[ahead] for seen in x], axis=1).reshape(-1, 2), 1, limit / 2, 20,
        )  # fmt: skip
        fits = (bundle.residuals.reshape(-1, len(x)) <= 2 * limit).all(axis=1)
        keep = np.zeros(len(xyz), bool)
        keep[index[fits]] = True
        xyz = np.where(keep[:, None], 0.0, xyz)
        xyz[index] = bundle.xyz_in_world
        first = bundle.cameras_from_world[0]
        return [p @ first.inverse() for p in bundle.cameras_from_world], first.apply(xyz), keep
