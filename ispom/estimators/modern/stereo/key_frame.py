"""What makes a pair a key frame of the stereo estimator, and what it adds: new points, a window adjusted, a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.adjustment import optimised
from ispom.estimators.modern.rolling import steady
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.corrections import corrections
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints, TrackingResult
from ispom.estimators.modern.stereo.pair_calibration import intersected, with_rows
from ispom.estimators.modern.stereo.rolling_window import adjusted, without_oldest
from ispom.estimators.modern.stereo.row_motions import with_motions
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.window import KeyFrame, StereoMap, with_key
from ispom.features.row_search import PointSearch
from ispom.features.shi_tomasi import at_subpixel, detect_spread
from ispom.geometry import Array, Pose
from ispom.numerics.places import common, places
from ispom.numerics.reductions import lengths, median
from ispom.numerics.twist import twist_of
from ispom.persistent_list import PersistentList
from ispom.types import Decision

CORNER_DISTANCE_PX = 8.0
"""Least distance of a new corner from other points: with less, patches of 11 pixels see nearly the same."""
CROWD = 2.0
"""Times its share of the points that a part of the image may hold. The strongest corners alone stand in heaps, mostly
on what is far ahead, and what they have in common, such as one edge's disparity, is not averaged out; of equal shares
many are weak ones."""
CANDIDATES = 1.8
"""Corners looked for, over those wanted: of nearly half the match is not as sure as of most."""
LIKE_MOST = 1.3
"""Times their median that deviations of new disparities may be, and what patches differ by. What a patch predicts of
its match is what it turns out to be off by, from 0.03 px to ten times that; one that sees two surfaces is off by more,
towards the nearer one, and differs by more than the sensor's noise. One weight and one covariance for all points hold
for like ones."""
SAME_GREY = 2.0
"""Differences [grey levels] below this are as good as each other: the noise of a camera at its best."""
SURE_PX = 0.03
"""Deviations below this are as good as each other: images without noise would leave out all but their finest match."""
CORNER_RADIUS_PX, CORNER_STEPS = 3, 5
"""Of the sub-pixel place of a corner."""


@dataclass(frozen=True, eq=False)
class Current:
    """The pair that is being worked on, once it has a pose."""

    new: NewPair
    pose: Pose
    """left_from_world."""
    points: PairPoints
    """Those alive."""
    motion: Array
    """(12,) of left_from_world, as of rolling.mean_rates: since the last pair, 0 where that is a gap; or while the rows
    of a rolling shutter were exposed."""

    @staticmethod
    def of(state: ModernStereoState, new: NewPair, sighting: TrackingResult) -> Current:
        """Located, or where the motion led."""
        last, located = state.last, sighting.located
        pose = last.predicted(new.time_ns) if located is None else located.camera_from_world
        motion = np.zeros(12)
        if sighting.motion is not None:
            motion = sighting.motion
        elif last.left is not None and not sighting.relocated:
            way = pose @ last.left_from_world.inverse()
            motion = steady(twist_of(way) / ((new.time_ns - last.time_ns) * 1e-9))
        return Current(new, pose, sighting.alive(last.points), motion)

    def as_key(self, setup: Setup, points: PairPoints) -> KeyFrame:
        """With these points, as they are in the pair."""
        seen = points.seen_by(setup.camera)
        return KeyFrame(self.new.time_ns, self.pose, points.ids, seen, self.motion, points.slants, setup.shutter)


def key_frame_tests(setup: Setup, world: StereoMap, points: PairPoints) -> tuple[Decision, ...]:
    """Large displacement, or too few of the last key frame's points left: each makes a key frame; none, the first."""
    if not world.keys:
        return ()
    last, camera = world.keys[-1], setup.camera
    old, new = common(last.ids, points.ids)
    flow = (camera.normalise(points.uv[new]) - last.seen[old, :2]) * camera.fx
    displacement = median(lengths(flow)) if len(new) else 0.0
    share = len(new) / max(len(last.ids), 1)
    return (
        checks.DISPLACEMENT.of(displacement, setup.min_parallax_px),
        checks.POINTS_LEFT.of(share, setup.min_share),
    )


def corners(setup: Setup, new: NewPair, points: PairPoints, share: float = 1.0) -> NDArray[np.float32]:
    """(N, 2) [px] in the left image, between the points there are; so many that with them there are `share` times as
    many points as are tracked."""
    count = int(share * setup.max_tracks)
    found = detect_spread(new.left, count, points.uv, CORNER_DISTANCE_PX, crowd=CROWD, half=new.halves[0])
    return at_subpixel(new.left, found, CORNER_RADIUS_PX, CORNER_STEPS)


def new_points(setup: Setup, state: ModernStereoState, now: Current) -> PairPoints:
    """Corners between the points there are, with their disparity."""
    new, uv = now.new, corners(setup, now.new, now.points, CANDIDATES)
    matches = PointSearch().search(new.left, new.right, uv, new.halves)
    found = np.flatnonzero(np.isfinite(matches.disparity_px))
    if len(found) > setup.min_inliers:
        sure = _like_most(matches.deviations_px[found], SURE_PX) & _like_most(matches.differences[found], SAME_GREY)
        found = found[sure]
    found = found[: max(setup.max_tracks - len(now.points), 0)]
    ids = state.next_id + np.arange(len(found))
    return PairPoints(ids, uv[found], matches.disparity_px[found], matches.slants[found])


def _like_most(values: Array, least: float) -> NDArray[np.bool_]:
    """(N,) which are about as small as usual, or as `least`."""
    return np.asarray(values <= LIKE_MOST * max(median(values), least))


def extended(
    setup: Setup, state: ModernStereoState, now: Current, fresh: PairPoints, sighting: TrackingResult
) -> tuple[ModernStereoState, Current, tuple[Decision, ...]]:
    """The window with this pair as a key frame, adjusted; and the pair as that left it.

    The adjustment knows nothing of points seen once: the fresh ones are placed by the pose and the pair that it found.
    """
    points, world = PairPoints.joined(now.points, fresh), state.map
    key = now.as_key(setup, points)
    predicted = None
    if not world.keys and state.last.left is not None:
        predicted = state.last.predicted_covariance(now.new.time_ns, setup.baseline_m)
    world = _with_row_errors(
        setup, with_key(world, key, setup.extra_sigma, setup.settling_s, predicted), state, now, sighting
    )
    world = with_motions(setup, world)
    world, settled, decisions = _adjusted(setup, world, state.settled)
    newest = world.keys[-1]
    near = intersected(setup, world, fresh, newest.motion)
    world = world.with_points(fresh.ids, newest.left_from_world.inverse().apply(near))
    points = points.select(places(newest.ids, points.ids) >= 0)
    now = replace(now, pose=newest.left_from_world, points=points)
    next_id = state.next_id + len(fresh)
    return replace(state, map=world.only(points.ids), settled=settled, next_id=next_id), now, decisions


def _with_row_errors(
    setup: Setup, world: StereoMap, state: ModernStereoState, now: Current, sighting: TrackingResult
) -> StereoMap:
    """With what the rows of this pair say about the right camera."""
    located = sighting.located
    if located is None:
        return world
    place = sighting.place[sighting.took_part[located.inliers]]
    near, lower = now.pose.apply(state.map.xyz[place]), sighting.lower[located.inliers]
    return with_rows(setup, world, state.map.ids[place], near, lower, now.motion[:6])


def _adjusted(
    setup: Setup, world: StereoMap, settled: PersistentList[tuple[int, Pose]]
) -> tuple[StereoMap, PersistentList[tuple[int, Pose]], tuple[Decision, ...]]:
    """The window adjusted; what is too much for it becomes a prior."""
    world, result = adjusted(setup, world)
    count, then = len(world.keys), ""
    while len(world.keys) > setup.window:
        oldest = world.keys[0]
        then = f"the oldest was marginalised, with its {len(oldest.ids)} points"
        settled = settled.appended((oldest.time_ns, oldest.left_from_world))
        world = without_oldest(setup, world)
    if result is None:
        return world, settled, ()
    far = int((result.distances > setup.limit).sum())
    went = (
        *optimised(result.cost_before, result.cost_after, result.iterations, setup.iterations),
        checks.OUTLIERS.of(far, len(result.distances)),
        checks.WINDOW.of(count, setup.window, then),
    )
    f = setup.camera.fx
    error = median(result.distances) * f if len(result.distances) else 0.0
    usual = 2 * setup.noise_px.sigma
    told = checks.NOISE.of(f * world.noise.sigma(setup.noise.sigma), setup.noise_px.sigma, world.noise.describe(f))
    return world, settled, (checks.ADJUSTED_ERROR.of(error, usual), told, *went, *corrections(setup, world))
