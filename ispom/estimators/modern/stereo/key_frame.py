"""Decides when a frame becomes a keyframe, and extends the map by it."""

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
from ispom.estimators.modern.stereo.rolling_window import adjusted, with_motions, without_oldest
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.shutter import row_times
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
"""Least distance [px] of a new corner from other points: patches of 11 pixels would show nearly the same."""
CROWD = 2.0
"""Most points in a part of the image, relative to an equal share. Without a limit the strongest corners cluster, mostly
far ahead, and common errors, such as one edge's disparity, do not average out. With equal shares many are weak."""
CANDIDATES = 1.8
"""Number of corners detected, relative to those needed: nearly half have a match that is less accurate than most."""
LIKE_MOST = 1.3
"""Largest standard deviation of a new disparity, and largest difference of its patches, relative to the median. The
predicted deviations agree with the errors from 0.03 px to ten times that. A patch that shows two surfaces is biased
towards the nearer one, and differs by more than the sensor's noise. All points get the same weight and covariance, so
their accuracy must be similar."""
SAME_GREY = 2.0
"""Difference of patches [grey levels] below which all count as equally good: the noise of a camera at its best."""
SURE_PX = 0.03
"""Standard deviation [px] below which matches count as equally good: noise-free images would keep only their best."""
CORNER_RADIUS_PX, CORNER_STEPS = 3, 5
"""Radius [px] and number of steps of the sub-pixel refinement of a corner."""


@dataclass(frozen=True, eq=False)
class Current:
    """The current frame, once it has a pose."""

    new: NewPair
    pose: Pose
    """left_from_world."""
    points: PairPoints
    """The points alive."""
    motion: Array
    """(12,) rate of left_from_world and its change, see rolling.steady: since the last frame, 0 after a gap; or
    during the exposure of a rolling shutter."""

    @staticmethod
    def of(state: ModernStereoState, new: NewPair, sighting: TrackingResult) -> Current:
        """Returns the frame at its localised pose, or else at the predicted one."""
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
        """Returns the frame as a keyframe that observed these points."""
        seen = points.seen_by(setup.camera)
        late_s = row_times(setup.camera, seen[:, 1])
        return KeyFrame(self.new.time_ns, self.pose, points.ids, seen, self.motion, points.slants, late_s)


def key_frame_tests(setup: Setup, world: StereoMap, points: PairPoints) -> tuple[Decision, ...]:
    """Returns the checks for a keyframe: large displacement, few of the last keyframe's points left; none at first."""
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
    """Detects corners (N, 2) [px] in the left image, which complete the points to `share` times `max_tracks`."""
    count = int(share * setup.max_tracks)
    found = detect_spread(new.left, count, points.uv, CORNER_DISTANCE_PX, crowd=CROWD, half=new.halves[0])
    return at_subpixel(new.left, found, CORNER_RADIUS_PX, CORNER_STEPS)


def new_points(setup: Setup, state: ModernStereoState, now: Current) -> PairPoints:
    """Detects corners between the present points, and keeps those with an accurate disparity."""
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
    """Returns a mask (N,) of the values that do not much exceed the median, or `least`."""
    return np.asarray(values <= LIKE_MOST * max(median(values), least))


def extended(
    setup: Setup, state: ModernStereoState, now: Current, fresh: PairPoints, sighting: TrackingResult
) -> tuple[ModernStereoState, Current, tuple[Decision, ...]]:
    """Adds this frame as a keyframe and optimises the window; returns the state, the frame and the decisions.

    Points observed once take no part in the optimisation; the new ones are triangulated with its results.
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
    """Adds the row differences of this frame to the prior of the right camera's corrections."""
    located = sighting.located
    if located is None:
        return world
    place = sighting.place[sighting.took_part[located.inliers]]
    near, lower = now.pose.apply(state.map.xyz[place]), sighting.lower[located.inliers]
    return with_rows(setup, world, state.map.ids[place], near, lower, now.motion[:6])


def _adjusted(
    setup: Setup, world: StereoMap, settled: PersistentList[tuple[int, Pose]]
) -> tuple[StereoMap, PersistentList[tuple[int, Pose]], tuple[Decision, ...]]:
    """Optimises the window, and marginalises the keyframes that exceed its size."""
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
