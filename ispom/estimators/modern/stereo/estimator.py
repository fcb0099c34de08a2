"""Stereo, modern: guided tracking in both images, reprojection in both, a window of key frames, self-calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ispom.estimators.check import Check
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.tracks import Last, PairTracker, Points, Sighting
from ispom.estimators.modern.stereo.window import (
    KeyFrame,
    StereoMap,
    adjusted,
    emptied,
    newest_covariance,
    with_key,
    with_rows,
    without_oldest,
)
from ispom.frontends import corners
from ispom.frontends.exposure import as_bright
from ispom.frontends.row_search import PointSearch
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range
from ispom.solvers.prior import PAIR
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Exposure,
    Image,
    Landmarks,
    Rig,
    Status,
    Step,
    StereoPair,
    Tracks,
    TrackStatus,
    Trajectory,
    as_grey,
    colours_at,
)

SIDE = 0.5
"""x/z of the place towards the image's sides, 27 degrees, at which the bend of the disparity offset is reported."""


@dataclass(frozen=True)
class ModernStereoConfig:
    """Settings of the modern stereo estimator."""

    max_tracks: Annotated[int, Range(50, 3000)] = 400
    """Points tracked at a time."""
    window: Annotated[int, Range(3, 20)] = 8
    """Key frames adjusted together; older ones become a prior."""
    self_calibration: bool = True
    """Estimate what is wrong with the rectification: an offset of the disparity, how it grows towards the image's
    sides, and a late right shutter."""
    offset_sigma_px: Annotated[float, Range(0.01, 10)] = 0.5
    """How far off the disparities may be in the middle of the image, before any data."""
    bend_sigma_px: Annotated[float, Range(0.01, 10)] = 1.0
    """How much farther off they may be at 45 degrees to its side, as a square and as a fourth power of x/z."""
    lag_sigma_s: Annotated[float, Range(1e-5, 0.1)] = 0.005
    """How late the right shutter may be, before any data."""
    loss_px: Annotated[float, Range(0.05, 5)] = 0.17
    """Scale of the Cauchy loss, and the error that covariances take a track to have: errors along it are alike."""
    max_error_px: Annotated[float, Range(0.5, 20)] = 2.5
    """Larger reprojection errors end a track."""
    min_parallax_px: Annotated[float, Range(0.5, 100)] = 20.0
    """Median displacement since the last key frame that makes the next one."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.7
    """A key frame is taken before a smaller share of the last one's points is left."""
    min_inliers: Annotated[int, Range(6, 500)] = 15
    """Fewer points than this, and the pair is not located."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last located one before the next starts afresh from where the motion led."""
    iterations: Annotated[int, Range(1, 30)] = 4
    """Of the adjustment, at each key frame."""

    def build(self, rig: Rig) -> ModernStereo:
        return ModernStereo(rig, self)


@dataclass(frozen=True, eq=False)
class ModernStereoState:
    last: Last
    map: StereoMap = StereoMap()
    next_id: int = 0
    lost_pairs: int = 0
    poses: PersistentList[tuple[int, int, Pose]] = PersistentList()
    """Time, the key frame's time, left_from_key of every located pair."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """left_from_world of the key frames that have left the window."""


@dataclass(frozen=True, eq=False)
class ModernStereo:
    """Metric; needs no key frame to follow, and corrects the last few as it goes. World: the rig at the first pair."""

    rig: Rig
    config: ModernStereoConfig

    def start(self) -> ModernStereoState:
        return ModernStereoState(Last(left_from_world=self._left_from_rig))

    def finish(self, state: ModernStereoState) -> Trajectory:
        keys = dict(state.settled) | {k.time_ns: k.left_from_world for k in state.map.keys}
        world_from_left = {t: (pose @ keys[key]).inverse() for t, key, pose in state.poses}
        return Trajectory.of([(t, pose @ self._left_from_rig) for t, pose in world_from_left.items()])

    def step(self, state: ModernStereoState, exposure: Exposure) -> tuple[ModernStereoState, Step]:
        """One pair: follow the points and locate it; at a key frame look for new points and adjust the window."""
        assert isinstance(exposure, StereoPair)
        watch = Stopwatch()
        left, kept = as_grey(exposure.left), state
        right = as_bright(as_grey(exposure.right), left)
        sighting, decisions = self._tracker.sight(state.last, state.map, left, right, exposure.time_ns)
        watch.lap("track")
        if state.map.keys and sighting.inliers < self.config.min_inliers:
            state, sighting, restart = self._lost(state, sighting)
            decisions += restart
            if not restart:
                return state, self._step(exposure, Status.LOST, None, state, sighting, decisions, watch)
        time_ns, located = exposure.time_ns, sighting.located
        pose = state.last.predicted(time_ns) if located is None else located.camera_from_world
        points = sighting.alive(state.last.points)
        is_key, why = self._choose_key_frame(state.map, points)
        decisions += why
        world, settled, next_id, fresh = state.map, state.settled, state.next_id, 0
        rate = self._rate(state, pose, time_ns)
        if is_key:
            found = self._new_points(world, points, left, right, pose, next_id, rate)
            fresh, next_id = len(found[0]), next_id + len(found[0])
            if len(points) + fresh < self.config.min_inliers and not world.keys:
                few = checks.DEPTH_POINTS.of(len(points) + fresh, self.config.min_inliers, "waiting to begin")
                # Nothing is seen: what was seen before is still the best to find the way from.
                status = Status.LOST if kept.map.keys else Status.INITIALISING
                kept = replace(kept, lost_pairs=state.lost_pairs)
                return kept, self._step(exposure, status, None, kept, sighting, (*decisions, few), watch)
            watch.lap("new points")
            points, world = Points.joined(points, found[0]), world.with_points(found[0].ids, found[1])
            key = KeyFrame(
                time_ns,
                pose,
                points.ids,
                points.seen_by(self.rig.camera("left")),
                rate,
            )
            spread = None
            if not world.keys and state.last.left is not None:
                spread = state.last.predicted_covariance(time_ns, self.rig.baseline_m)
            world = with_key(world, key, self._extra_sigma, spread)
            if self.config.self_calibration and located is not None and rate.any():
                took = sighting.took_part[located.inliers]
                xyz = pose.apply(state.map.xyz[sighting.place[took]])
                world = with_rows(world, world.rows.with_pair(xyz, sighting.lower[located.inliers], rate, self._loss))
            world, settled, bundled = self._adjusted(world, settled)
            decisions += bundled
            pose = world.keys[-1].left_from_world
            points = points.select(np.isin(points.ids, world.keys[-1].ids, assume_unique=True))
            world = world.only(points.ids)
            watch.lap("adjust")
        newest = world.keys[-1]
        last = Last(
            left,
            right,
            left if is_key else state.last.key_left,
            points,
            time_ns,
            pose,
            Pose() if state.last.left is None else pose @ state.last.left_from_world.inverse(),
            0.0 if state.last.left is None else (time_ns - state.last.time_ns) * 1e-9,
            sighting.features,
            self._covariance(world, pose, sighting, is_key),
        )
        way = (time_ns, newest.time_ns, pose @ newest.left_from_world.inverse())
        after = ModernStereoState(last, world, next_id, poses=state.poses.appended(way), settled=settled)
        status = Status.TRACKING if located is not None else Status.INITIALISING
        step = self._step(exposure, status, pose, after, sighting, decisions, watch, state, fresh, is_key)
        return after, step

    @property
    def _left_from_rig(self) -> Pose:
        return self.rig.rig_from_left.inverse()

    @property
    def _extra_sigma(self) -> Array:
        """(4,) see window.Window.extra; 0 holds them."""
        if not self.config.self_calibration:
            return np.zeros(PAIR)
        c, f = self.config, self.rig.camera("left").fx
        return np.array([c.offset_sigma_px / f, c.lag_sigma_s, c.bend_sigma_px / f, c.bend_sigma_px / f])

    @property
    def _tracker(self) -> PairTracker:
        camera, config = self.rig.camera("left"), self.config
        return PairTracker(camera, self.rig.baseline_m, self._loss, self._limit, config.min_inliers)

    @property
    def _loss(self) -> float:
        return self.config.loss_px / self.rig.camera("left").fx

    @property
    def _limit(self) -> float:
        return self.config.max_error_px / self.rig.camera("left").fx

    def _rate(self, state: ModernStereoState, pose: Pose, time_ns: int) -> Array:
        """(6,) of left_from_world's change (rho [m/s], phi [rad/s]; left) since the last pair."""
        if state.last.left is None:
            return np.zeros(6)
        return (pose @ state.last.left_from_world.inverse()).log() / ((time_ns - state.last.time_ns) * 1e-9)

    def _lost(
        self, state: ModernStereoState, sighting: Sighting
    ) -> tuple[ModernStereoState, Sighting, tuple[Decision, ...]]:
        """Keep the last located pair for the next one; after some failures begin again from where the motion led."""
        state = replace(state, lost_pairs=state.lost_pairs + 1)
        limit = self.config.max_lost_pairs
        if state.lost_pairs <= limit:
            return state, sighting, ()
        settled = state.settled.extended((k.time_ns, k.left_from_world) for k in state.map.keys)
        fresh = replace(state.last, points=Points())
        state = replace(state, last=fresh, map=emptied(state.map), settled=settled)
        decision = checks.LOST_PAIRS.of(state.lost_pairs, limit, "a new start from the prediction")
        return state, Sighting.nothing(), (decision,)

    def _choose_key_frame(self, world: StereoMap, points: Points) -> tuple[bool, tuple[Decision, ...]]:
        """Large displacement, or too few of the last key frame's points left."""
        if not world.keys:
            return True, ()
        last, camera = world.keys[-1], self.rig.camera("left")
        _, old, new = np.intersect1d(last.ids, points.ids, assume_unique=True, return_indices=True)
        flow = (camera.normalise(points.uv[new]) - last.seen[old, :2]) * camera.fx
        displacement = float(np.median(np.linalg.norm(flow, axis=1))) if len(new) else 0.0
        share = len(new) / max(len(last.ids), 1)
        wanted, least = self.config.min_parallax_px, self.config.min_share
        tests = (checks.DISPLACEMENT.of(displacement, wanted), checks.POINTS_LEFT.of(share, least))
        return any(test.passed for test in tests), tests

    def _new_points(
        self, world: StereoMap, points: Points, left: Image, right: Image, pose: Pose, next_id: int, rate: Array
    ) -> tuple[Points, Array]:
        """Corners between the points there are, with a place in the world from their disparity."""
        uv = corners.detect(left, self.config.max_tracks - len(points), points.uv)
        disparity = PointSearch().search(left, right, uv)
        found = np.flatnonzero(np.isfinite(disparity))
        fresh = Points(next_id + np.arange(len(found)), uv[found], disparity[found])
        return fresh, pose.inverse().apply(self._tracker.intersected(world, fresh, rate))

    def _adjusted(
        self, world: StereoMap, settled: PersistentList[tuple[int, Pose]]
    ) -> tuple[StereoMap, PersistentList[tuple[int, Pose]], tuple[Decision, ...]]:
        """The window adjusted; what is too much for it becomes a prior."""
        baseline, sigma = self.rig.baseline_m, self._extra_sigma
        world, result = adjusted(world, baseline, sigma, self._loss, self._limit, self.config.iterations)
        while len(world.keys) > self.config.window:
            oldest = world.keys[0]
            settled = settled.appended((oldest.time_ns, oldest.left_from_world))
            world = without_oldest(world, baseline, sigma, self._loss)
        if result is None:
            return world, settled, ()
        f = self.rig.camera("left").fx
        error = float(np.median(result.distances)) * f if len(result.distances) else 0.0
        usual = 2 * self.config.loss_px
        decisions = [checks.ADJUSTED_ERROR.of(error, usual)]
        if self.config.self_calibration and world.covariance is not None:
            (offset, lag, square, fourth), spread = world.extra, world.covariance[-PAIR:, -PAIR:]
            bend = np.array([SIDE**2, SIDE**4])
            decisions += [
                _corrected(checks.OFFSET, f * offset, f**2 * spread[0, 0]),
                _corrected(checks.BEND, f * float(bend @ (square, fourth)), f**2 * float(bend @ spread[2:, 2:] @ bend)),
                _corrected(checks.SHUTTER_LAG, 1e3 * lag, 1e6 * spread[1, 1]),
            ]
        return world, settled, tuple(decisions)

    def _step(
        self,
        exposure: StereoPair,
        status: Status,
        pose: Pose | None,
        after: ModernStereoState,
        sighting: Sighting,
        decisions: tuple[Decision, ...],
        watch: Stopwatch,
        before: ModernStereoState | None = None,
        fresh: int = 0,
        is_key: bool = False,
    ) -> Step:
        camera, residual = self.rig.camera("left"), np.full(len(sighting.status), np.nan, np.float32)
        if sighting.located is not None:
            residual[sighting.took_part] = np.minimum(sighting.located.distances * camera.fx, 1e4)
        tracks, landmarks, revised = Tracks.of(np.zeros(0), np.zeros((0, 2))), Landmarks.empty(), Trajectory.empty()
        if before is not None:
            old, new = before.last.points, after.last.points
            count = len(sighting.status)
            ids = np.concatenate([old.ids[:count], new.ids[len(new) - fresh :]])
            ended = (sighting.status != TrackStatus.ALIVE) & (sighting.status < TrackStatus.EPIPOLAR)
            uv = np.where(ended[:, None], old.uv[:count], sighting.uv)
            nan = np.full((fresh, 2), np.nan, np.float32)
            tracks = Tracks.of(
                ids,
                np.concatenate([uv, new.uv[len(new) - fresh :]]),
                uv_prev=np.concatenate([old.uv[:count], nan]),
                status=np.concatenate([sighting.status, np.full(fresh, TrackStatus.NEW, np.uint8)]),
                residual_px=np.concatenate([residual, nan[:, 0]]),
                disparity_px=np.concatenate([sighting.disparity_px, new.disparity_px[len(new) - fresh :]]),
            )
        world_from_rig, spread = None, None
        if pose is not None:
            world_from_rig = pose.inverse() @ self._left_from_rig
            if (known := after.last.covariance) is not None:
                # left_from_world grows by exp(d) on the left: world_from_rig by exp(-Ad(rig_from_left) d) on the right
                adjoint = self.rig.rig_from_left.adjoint
                spread = adjoint @ known @ adjoint.T
        if is_key:
            place = after.map.places(after.last.points.ids)
            landmarks = Landmarks(
                after.last.points.ids, after.map.xyz[place], colours_at(exposure.left, after.last.points.uv)
            )
            revised = Trajectory.of(
                [(k.time_ns, k.left_from_world.inverse() @ self._left_from_rig) for k in after.map.keys[:-1]]
            )
        inliers = residual[np.isfinite(residual) & (sighting.status == TrackStatus.ALIVE)]
        watch.lap("conclude")
        return Step(
            exposure.time_ns,
            status,
            "rig",
            world_from_rig,
            spread,
            is_key,
            {"left": tracks},
            landmarks,
            inliers,
            revised,
            seconds=watch.seconds,
            decisions=decisions,
            calibration={"pair": after.map.extra, "pair_rate": after.map.felt(after.last.rate)},
        )

    def _covariance(self, world: StereoMap, pose: Pose, sighting: Sighting, is_key: bool) -> Array | None:
        """(6, 6) of left_from_world's left twist: the newest key frame's, and the way from there."""
        spread = newest_covariance(world)
        if spread is None or is_key or sighting.located is None:
            return spread
        way = (pose @ world.keys[-1].left_from_world.inverse()).adjoint
        return way @ spread @ way.T + np.linalg.inv(sighting.located.information)


def _corrected(check: Check, value: float, variance: float) -> Decision:
    """What the pair's images say against its calibration, beside two standard deviations of it."""
    twice = 2 * float(np.sqrt(max(variance, 0.0)))
    return check.of(value, twice, passed=bool(abs(value) > twice))
