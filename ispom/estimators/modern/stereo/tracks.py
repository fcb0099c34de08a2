"""Following the stereo estimator's points into the next pair, and locating it: guided, around, or by descriptors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.frontends import sift
from ispom.frontends.exposure import as_bright
from ispom.frontends.klt import Klt
from ispom.frontends.patches import align, warps_of
from ispom.frontends.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.solvers.late_shutter import drift
from ispom.solvers.motion_only import PoseFit, fit_pose
from ispom.solvers.resection import resect
from ispom.solvers.window import offset_at
from ispom.types import Camera, Decision, Image, TrackStatus

MIN_CORRELATION, MAX_SHIFT_PX = 0.7, 1.5
"""Of a patch found again and its origin; and how far from where tracking led."""
COASTING_S = 2.0
"""Out of sight the motion is held to go on for so long, or for one more interval between pairs; then to end."""
ONE_WAY = Klt(levels=2, max_forward_backward_px=np.inf)
"""From a good guess; the key frame's patch then checks what was found."""


@dataclass(frozen=True, eq=False)
class Points:
    """The points alive in the previous left image."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    disparity_px: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    """(N,) NaN where unknown."""

    def __len__(self) -> int:
        return len(self.ids)

    @staticmethod
    def joined(a: Points, b: Points) -> Points:
        uv, disparity = np.concatenate([a.uv, b.uv]), np.concatenate([a.disparity_px, b.disparity_px])
        return Points(np.concatenate([a.ids, b.ids]), uv, disparity)

    def seen_by(self, camera: Camera) -> Array:
        """(N, 3) normalised x, y in the left image, x in the right one or NaN."""
        x = camera.normalise(self.uv)
        return np.column_stack([x, x[:, 0] - self.disparity_px / camera.fx])

    def select(self, keep: NDArray[np.bool_]) -> Points:
        return Points(self.ids[keep], self.uv[keep], self.disparity_px[keep])


def unforeseen(way: Pose, baseline_m: float) -> Array:
    """(6,) standard deviations of how a motion may differ from this expected one: half of it, and a little at rest."""
    moved, turned = float(np.linalg.norm(way.translation)), float(np.linalg.norm(way.rotvec))
    return np.repeat([0.5 * moved + 0.1 * baseline_m, 0.5 * turned + 0.05], 3)


@dataclass(frozen=True, eq=False)
class Last:
    """The last located pair."""

    left: Image | None = None
    right: Image | None = None
    key_left: Image | None = None
    """Of the newest key frame."""
    points: Points = Points()
    time_ns: int = 0
    left_from_world: Pose = field(default_factory=Pose)
    motion: Pose = field(default_factory=Pose)
    """curr_left_from_prev_left of the last two located pairs."""
    motion_s: float = 0.0
    """Time between them; 0 before there are two."""
    described: sift.Features | None = None
    """Of the left image, where descriptors were needed to locate it."""
    covariance: Array | None = None
    """(6, 6) of left_from_world's left twist."""

    @property
    def rate(self) -> Array:
        """(6,) of left_from_world's change (rho [m/s], phi [rad/s]), left."""
        return self.motion.log() / self.motion_s if self.motion_s > 0 else np.zeros(6)

    def predicted(self, time_ns: int) -> Pose:
        """left_from_world if the motion goes on as it was, COASTING_S long at most."""
        return self._way(self._coasting_s(time_ns)) @ self.left_from_world

    def predicted_covariance(self, time_ns: int, baseline_m: float) -> Array:
        """(6, 6) of the left twist of `predicted`: what was known before, and how much else may have happened since.

        That is the more, the longer nothing was seen: the motion may have gone on after the prediction holds it to end.
        """
        coasting_s = self._coasting_s(time_ns)
        way, beyond = self._way(coasting_s), (self._since_s(time_ns) - coasting_s) * self.rate
        known = np.zeros((6, 6)) if self.covariance is None else way.adjoint @ self.covariance @ way.adjoint.T
        moved, turned = float(np.linalg.norm(beyond[:3])), float(np.linalg.norm(beyond[3:]))
        further = np.repeat([moved, min(turned, np.pi)], 3)
        return known + np.diag((unforeseen(way, baseline_m) + further) ** 2)

    def _since_s(self, time_ns: int) -> float:
        return (time_ns - self.time_ns) * 1e-9

    def _coasting_s(self, time_ns: int) -> float:
        return min(self._since_s(time_ns), max(COASTING_S, self.motion_s))

    def _way(self, seconds: float) -> Pose:
        if self.motion_s <= 0:
            return Pose()
        return Pose.exp(self.motion.log() * (seconds / self.motion_s))


@dataclass(frozen=True, eq=False)
class Sighting:
    """Where the points of the last pair are in this one."""

    uv: NDArray[np.float32]
    """(N, 2) [px] in the left image."""
    disparity_px: NDArray[np.float32]
    """(N,) NaN where not found in the right image."""
    status: NDArray[np.uint8]
    place: NDArray[np.int64]
    """(N,) in the map, or -1."""
    located: PoseFit | None
    took_part: NDArray[np.int64]
    """(K,) which of the points `located` is about."""
    lower: NDArray[np.float32]
    """(K,) normalised: how much lower these are in the right image; NaN where not found."""
    features: sift.Features | None = None
    """Of the left image, where they were needed."""

    @staticmethod
    def nothing() -> Sighting:
        empty, none = np.zeros(0, np.int64), Points()
        return Sighting(none.uv, none.disparity_px, empty.astype(np.uint8), empty, None, empty, none.disparity_px)

    def alive(self, points: Points) -> Points:
        """Those of the points followed that are alive, at their places now."""
        keep = self.status == TrackStatus.ALIVE
        return Points(points.ids[: len(keep)][keep], self.uv[keep], self.disparity_px[keep])

    @property
    def inliers(self) -> int:
        return 0 if self.located is None else int(self.located.inliers.sum())


@dataclass(frozen=True)
class PairTracker:
    """Follows points and locates pairs."""

    camera: Camera
    """The left one; the right one is the same."""
    baseline_m: float
    loss: float
    """Scale of the Cauchy loss, normalised."""
    limit: float
    """Larger reprojection errors end a track, normalised."""
    min_inliers: int

    def sight(
        self, last: Last, world: StereoMap, left: Image, right: Image, time_ns: int
    ) -> tuple[Sighting, tuple[Decision, ...]]:
        """The points of the last pair in this one, and the pose: guided by the motion so far, or by descriptors."""
        guess = last.predicted(time_ns)
        sighting = self._follow(last, world, left, right, guess if last.motion_s > 0 else None, guess, time_ns)
        if last.left is None:
            return sighting, ()
        wanted = max(self.min_inliers, 0.3 * len(last.points))
        guided = checks.GUIDED_POINTS.of(sighting.inliers, wanted)
        if guided.passed:
            return sighting, (guided,)
        sighting = max(sighting, self._follow(last, world, left, right, None, guess, time_ns), key=lambda s: s.inliers)
        around = checks.NEARBY_POINTS.of(sighting.inliers, wanted)
        if around.passed:
            return sighting, (guided, around)
        features = sift.detect_and_describe(left, 2000)
        described = self._relocated(last, world, features)
        if described is not None:
            again = self._follow(last, world, left, right, described, described, time_ns)
            sighting = max(sighting, replace(again, features=features), key=lambda s: s.inliers)
        return sighting, (guided, around, checks.DESCRIBED_POINTS.of(sighting.inliers, self.min_inliers))

    def _follow(
        self, last: Last, world: StereoMap, left: Image, right: Image, guide: Pose | None, guess: Pose, time_ns: int
    ) -> Sighting:
        """Track into the left image from where `guide` puts the points, else from where they were; then right."""
        points, camera, place = last.points, self.camera, world.places(last.points.ids)
        if last.left is None or not len(points):
            return Sighting.nothing()
        near = guess.apply(world.xyz[place])
        if guide is None:
            # Where tracking failed so far, the exposure may have changed.
            uv, status = Klt(levels=5).track(last.left, as_bright(left, last.left), points.uv)
        else:
            expected = camera.project(near).astype(np.float32)
            lost = ~np.isfinite(expected).all(1)
            expected[lost] = points.uv[lost]
            uv, status = ONE_WAY.track(last.left, left, points.uv, expected)
        uv, status = self._refined(last, world, left, uv, status, near, guess)
        alive = np.flatnonzero(status == TrackStatus.ALIVE)
        disparity = np.full(len(points), np.nan, np.float32)
        depth = np.maximum(near[alive, 2], 0.1)
        disparity[alive], lower = PointSearch().follow(
            left, right, uv[alive], (camera.fx * self.baseline_m / depth).astype(np.float32)
        )
        seen = Points(points.ids[alive], uv[alive], disparity[alive]).seen_by(self.camera)
        located = self._locate(last, world, place[alive], seen, guess, time_ns)
        if located is not None:
            status[alive[~located.inliers]] = TrackStatus.REPROJECTION
        return Sighting(uv, disparity, status, place, located, alive, lower / camera.fy)

    def _refined(
        self,
        last: Last,
        world: StereoMap,
        left: Image,
        uv: NDArray[np.float32],
        status: NDArray[np.uint8],
        near: Array,
        guess: Pose,
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Places sought again from the newest key frame's image: a chain of small steps drifts, most at rest.

        Patches are warped as the points `near` (N, 3) to the camera say, seen from `guess`: unwarped ones that grow
        drift outwards. What does not look like its patch any more is lost.
        """
        if last.key_left is None:
            return uv, status
        key, camera = world.keys[-1], self.camera
        _, old, new = np.intersect1d(key.ids, last.points.ids, assume_unique=True, return_indices=True)
        alive = status[new] == TrackStatus.ALIVE
        old, new = old[alive], new[alive]
        start = camera.project(np.column_stack([key.seen[old, :2], np.ones(len(old))])).astype(np.float32)
        back = key.left_from_world @ guess.inverse()
        warps = warps_of(camera, back.rotation[None], back.translation[None], near[new])
        again, score = align(last.key_left, start, left, uv[new], warps)
        good = (score > MIN_CORRELATION) & (np.linalg.norm(again - uv[new], axis=1) < MAX_SHIFT_PX)
        uv, status = uv.copy(), status.copy()
        uv[new[good]] = again[good]
        status[new[~good]] = TrackStatus.LOST
        return uv, status

    def _locate(
        self, last: Last, world: StereoMap, place: NDArray[np.int64], seen: Array, guess: Pose, time_ns: int
    ) -> PoseFit | None:
        """left_from_world by reprojection in both images; from three-point samples where the guess is poor."""
        xyz, baseline = world.xyz[place], self.baseline_m
        moved = guess @ last.left_from_world.inverse()
        rate = moved.log() / ((time_ns - last.time_ns) * 1e-9)
        prior = None
        if len(xyz) < 3 * self.min_inliers:
            prior = np.diag(unforeseen(moved, baseline) ** -2)
        seen = self._freed(world, guess.apply(xyz), seen, rate)
        arguments = self.loss, self.limit, baseline
        found = fit_pose(xyz, seen, guess, *arguments, prior)
        if found is None or found.inliers.mean() < 0.6:
            sampled = resect(xyz, seen[:, :2], self.limit)
            if sampled is not None:
                again = fit_pose(xyz, seen, sampled.camera_from_world, *arguments, prior, widest=self.limit)
                if again is not None and (found is None or again.inliers.sum() > found.inliers.sum()):
                    found = again
        return found

    def _relocated(self, last: Last, world: StereoMap, now: sift.Features) -> Pose | None:
        """left_from_world by descriptors shared with the last located pair."""
        assert last.left is not None and last.right is not None
        before = last.described or sift.detect_and_describe(last.left, 2000)
        pairs = sift.match(before, now)
        uv = before.uv[pairs[:, 0]]
        disparity = PointSearch().search(last.left, last.right, uv)
        good = disparity >= 1
        xyz = self.intersected(world, Points(pairs[good, 0], uv[good], disparity[good]), last.rate)
        x = self.camera.normalise(now.uv[pairs[good, 1]].astype(float))
        found = resect(xyz, x, 2 * self.limit)
        return None if found is None else found.camera_from_world @ last.left_from_world

    def _freed(self, world: StereoMap, near: Array, seen: Array, rate: Array) -> Array:
        """(N, 3) what was seen, the right x as of a perfect pair, where points are `near` (N, 3) in the left camera."""
        right, lag = seen[:, 2], world.extra[1]
        late = drift(near, np.broadcast_to(world.felt(rate), (len(near), 6)), lag, self.baseline_m)
        return np.column_stack([seen[:, :2], right - offset_at(right, world.extra) - (1 + right**2) * lag * late])

    def intersected(self, world: StereoMap, points: Points, rate: Array) -> Array:
        """(N, 3) in the left camera from disparities, freed of the offset found so far; far ones at 2000 baselines."""
        seen = points.seen_by(self.camera)
        lag, rate = world.extra[1], world.felt(rate)
        x, y, right = seen[:, 0], seen[:, 1], seen[:, 2] - offset_at(seen[:, 2], world.extra)
        disparity = x - right + lag * (rate[4] - rate[5] * y - right * (rate[3] * y - rate[4] * x))
        depth = (self.baseline_m - lag * (rate[0] - right * rate[2])) / np.maximum(disparity, 1 / 2000)
        return np.column_stack([seen[:, :2], np.ones(len(seen))]) * depth[:, None]
