"""Decides on keyframes of the monocular estimator, and extends and optimises the map with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.adjustment import optimised
from ispom.estimators.modern.keyframe_database import Keyframe
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.localise import Localisation
from ispom.estimators.modern.monocular.map import Map, bundle_problem, optimise, triangulate
from ispom.estimators.modern.monocular.setup import INLIER, MOVING, WIDTH, Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import at_middle_row, tracks_with_speeds
from ispom.estimators.modern.monocular.window import (
    NEWEST_KEYFRAMES,
    newest_keyframes,
    report_removed,
    settle_old_frames,
    shorten_window,
)
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame, parallax_deg
from ispom.geometry import rotation_angle_rad
from ispom.numerics.places import common, places
from ispom.numerics.robust import Noise
from ispom.types import Decision, TrackStatus

ITERATIONS = 5
"""Largest number of iterations per bundle adjustment; the next keyframe's continues from the result."""
MIN_SIGNIFICANCE = 7.5
"""Least inverse depth of a new point, in its standard deviations: its depth is then known to about 13 %, within which
bundle adjustment is close to linear."""
MIN_SCALE_SIGNIFICANCE, MIN_DEPTHS = 15.0, 8
"""The same for points whose depths are compared between the last two keyframes and the map, and the least number of
such points for a scale."""
MAX_DRIFT = 10.0
"""Scale drift since the start [%, 1 sigma] beyond which the report marks it; it has no other effect."""
MIN_GAP = 5.5
"""Ratio of the frame interval to the one before, from which there is a gap: at least five frames are missing. For
shorter gaps, as where a camera drops frames, tracking loses little, and keyframes would be too frequent."""
KEPT_WITHIN = 1.2
"""Factor within which the unit of a segment stays: beyond it, two parts of a path no longer have the same scale."""
MAX_SCALE_GROWTH = float(np.log(KEPT_WITHIN)) / 3
"""Growth of the standard deviation of ln scale over the window, beyond which the scale is lost: three of them are the
factor KEPT_WITHIN."""
UNKNOWN_SCALE = 0.5
"""Standard deviation of ln scale beyond which the scale is unknown: two of them reach a length of zero, so that hardly
anything is known about a length."""


def keyframe_tests(setup: Setup, local_map: Map, frame: TrackedFrame) -> tuple[Decision, ...]:
    """Returns the checks each of which, if passed, makes `frame` the next keyframe of the map; the frame must have a
    pose."""
    key = local_map.keys[-1]
    parallax = parallax_deg(key, frame, setup.noise.width)
    placed = key.ids[np.isfinite(local_map.known(key.ids)[:, 0])]
    # Untriangulated tracks may be on a moving object, and outlast the scene.
    share = min(_share_left(key.ids, frame.ids), _share_left(placed, frame.ids))
    turn = key.pose.rotation.T @ frame.pose.rotation
    angle, interval = float(np.degrees(rotation_angle_rad(turn))), (frame.time_ns - key.time_ns) * 1e-9
    late = interval >= setup.max_interval_s and parallax >= setup.min_parallax_deg / 4
    why = "too little parallax for a keyframe" if interval >= setup.max_interval_s and not late else ""
    return (
        checks.PARALLAX.of(parallax, setup.min_parallax_deg),
        checks.POINTS_LEFT.of(share, setup.min_share),
        checks.VIEW_ANGLE.of(angle, setup.max_view_angle_deg),
        checks.INTERVAL.of(interval, setup.max_interval_s, why, late),
    )


def _share_left(before: NDArray[np.int64], now: NDArray[np.int64]) -> float:
    return len(common(before, now)[0]) / max(1, len(before))


@dataclass(frozen=True, eq=False)
class ExtendedMap:
    """The map with one more keyframe."""

    map: Map
    dropped: NDArray[np.int64]
    """Tracks that do not observe a static point."""
    uncertainty: MapUncertainty
    """Uncertainty of the map."""
    scale: float | None
    decisions: tuple[Decision, ...]


def with_keyframe(setup: Setup, local_map: Map, frame: TrackedFrame) -> tuple[Map, NDArray[np.int64]]:
    """Adds the keyframe and new points with enough parallax, without optimisation. Also returns the ids of tracks
    without a point that do not observe a static point."""
    width, local_map = setup.noise.width, replace(local_map, keys=(*local_map.keys, frame))
    ids = frame.ids[~np.isfinite(local_map.known(frame.ids)[:, 0])]
    new = triangulate(local_map, ids, setup.noise)
    wide = (new.parallax_rad > setup.point_parallax_rad) & (new.significance > MIN_SIGNIFICANCE)
    good = wide & (new.depth > 0) & (new.worst < INLIER * width)
    points = local_map.points.merged(ScenePoints(ids[good], new.xyz_in_world[good]))
    moving = (wide | (new.depth <= 0)) & (new.worst > MOVING * width)
    return replace(local_map, points=points), ids[moving]


def extend_map(setup: Setup, local_map: Map, frame: TrackedFrame) -> ExtendedMap:
    """Adds the keyframe and new points with enough parallax, and runs windowed bundle adjustment."""
    known, width, f = local_map.points.ids, setup.noise.width, setup.camera.fx
    local_map, moving = with_keyframe(setup, local_map, frame)
    local_map, bundle, before = optimise(local_map.with_loss(width), width, ITERATIONS)
    local_map = replace(local_map, noise=local_map.noise.after(bundle, local_map.loss))
    outliers = before.ids[places(local_map.points.ids, before.ids) < 0]
    size = f"{len(local_map.keys)} keyframes, {len(before.ids)} points, {len(bundle.distances)} observations"
    noise_px = f * local_map.noise.sigma(setup.noise.sigma)
    noise = f"{local_map.noise.describe(f)}, loss {f * local_map.loss:.2f} px wide"
    times_ns = tuple(k.time_ns for k in local_map.keys)
    uncertainty = MapUncertainty.of(bundle.window, times_ns, before.ids, local_map.loss)
    scale, drift = _measure_scale(local_map, known, setup.noise, uncertainty)
    decisions = (
        checks.BUNDLE_COST.of(bundle.cost_after / max(bundle.cost_before, 1e-12), 1.0, size),
        *optimised(bundle.cost_before, bundle.cost_after, bundle.iterations, ITERATIONS),
        checks.OUTLIERS.of(len(outliers), len(before.ids)),
        checks.NOISE.of(noise_px, setup.noise_px.sigma, noise),
        *drift,
        *_report_lens(setup, local_map),
    )
    return ExtendedMap(local_map, np.concatenate([moving, outliers]), uncertainty, scale, decisions)


def _report_lens(setup: Setup, local_map: Map) -> tuple[Decision, ...]:
    """Reports the lens correction, if it is self-calibrated."""
    if not local_map.extra_sigma.any():
        return ()
    focal, radial = 100 * float(local_map.extra[0]), float(local_map.extra[1])
    limit = 300 * float(setup.extra_sigma[0]) / setup.noise.factor
    because = f"focal length {focal:+.2f} %, radial distortion {radial:+.4f}"
    return (checks.FOCAL_LENGTH.of(abs(focal), limit, because),)


def _measure_scale(
    local_map: Map, known: NDArray[np.int64], noise: Noise, uncertainty: MapUncertainty
) -> tuple[float | None, tuple[Decision, ...]]:
    """Returns the scale of the last step relative to the map, and its checks. The scale is the ratio of the depths of
    points that the map had before (`known` ids) to those triangulated from the last two keyframes only."""
    against = f"{100 * uncertainty.step_scale_sigma:.2g} % in the last step alone"
    since = checks.SCALE_DRIFT.of(100 * uncertainty.scale_sigma, MAX_DRIFT, against)
    pair = replace(local_map, keys=local_map.keys[-2:])
    ids = pair.keys[0].ids
    for others in (pair.keys[1].ids, known, local_map.points.ids):
        ids = ids[places(others, ids) >= 0]
    found = triangulate(pair, ids, noise)
    sure = (found.depth > 0) & (found.significance > MIN_SCALE_SIGNIFICANCE)
    if sure.sum() < MIN_DEPTHS:
        return None, (since,)
    depth = pair.poses[0].inverse().apply(local_map.points.xyz[local_map.points.places(ids)])[:, 2]
    scale = float(np.exp(np.median(np.log(np.maximum(depth[sure], 1e-12) / found.depth[sure]))))
    limit = max(3 * uncertainty.step_scale_sigma, 0.005)
    because = f"depth ratio {scale:.4f} ± {uncertainty.step_scale_sigma:.4f} of {int(sure.sum())} points"
    step = checks.STEP_SCALE.of(abs(scale - 1), limit, because)
    return scale, (step, since)


def keep_frame_before_gap(setup: Setup, state: ModernMonocularState, time_ns: int) -> ModernMonocularState:
    """Adds the last frame to the map as a keyframe if the next frame, at `time_ns`, comes after a gap.

    Tracks of the last second may be untriangulated, as only keyframes add points, and few of them survive the gap. The
    poses are not changed until the next keyframe optimises them all.
    """
    local_map, live = state.map, state.live
    if local_map is None or live.grey is None or state.missed:
        return state
    (before_ns, _), (last_ns, last) = state.recent[0], state.recent[-1]
    gap = time_ns - last_ns > MIN_GAP * (last_ns - before_ns) > 0
    if not gap or live.time_ns != last_ns or local_map.keys[-1].time_ns == last_ns:
        return state
    frame = TrackedFrame(last_ns, live.ids, setup.camera.normalise(at_middle_row(setup.camera, live)), last)
    others = tuple(b for b in local_map.relative_frames if b.time_ns != last_ns)
    local_map, _ = with_keyframe(setup, replace(local_map, relative_frames=others), frame)
    local_map, settled = shorten_window(local_map, live.ids, setup.key_frames)
    moved = tracks_with_speeds(setup.camera, live.uv, live.speed)
    database = state.database.with_keyframe(
        Keyframe.of(
            last_ns,
            last.inverse(),
            (live.grey,),
            state.covariance,
            moving=moved,
            segment=state.segment,
            depth_sigma=0.0 if state.uncertainty is None else state.uncertainty.depth_sigma,
        )
    )
    return replace(state, map=local_map, settled=state.settled.extended(settled), database=database)


def add_frame(
    setup: Setup, state: ModernMonocularState, outcome: Outcome, frame: TrackedFrame, localisation: Localisation
) -> Outcome:
    """Adds a frame that is no keyframe: its pose is relative to the last keyframe, the map's points are unchanged."""
    local_map = required(outcome.map, "the frame has no map").with_relative_frame(frame.time_ns, frame.pose)
    local_map, settled = settle_old_frames(local_map)
    uncertainty = required(state.uncertainty, "the map has no covariance")
    covariance = localisation.covariance(uncertainty, WIDTH * setup.noise.width)
    return replace(outcome, map=local_map, settled=tuple(settled), covariance=covariance)


def add_keyframe(setup: Setup, state: ModernMonocularState, outcome: Outcome, frame: TrackedFrame) -> Outcome:
    """Adds a keyframe: new points, bundle adjustment, a shorter window, and the check of the scale; where that is lost,
    a new segment begins."""
    ids, status = state.live.ids, outcome.tracked.status
    extended = extend_map(setup, required(outcome.map, "the frame has no map"), frame)
    status[np.isin(ids, extended.dropped) & (status == TrackStatus.ALIVE)] = TrackStatus.REPROJECTION
    local_map, settled = shorten_window(extended.map, ids[status == TrackStatus.ALIVE], setup.key_frames)
    removed = report_removed(extended.map, local_map, setup.key_frames)
    # After a relocalisation, recognised keyframes define the scale.
    joined = not outcome.restarted and state.worlds.join_of(state.segment) is not None
    scale = check_scale(() if outcome.restarted else state.depth_sigmas, extended.uncertainty, joined)
    outcome = replace(
        outcome,
        pose=local_map.poses[-1],
        map=local_map,
        key_frame=True,
        decisions=(*outcome.decisions, *extended.decisions, removed, scale),
        covariance=extended.uncertainty.pose,
        uncertainty=extended.uncertainty,
        scale=extended.scale,
        settled=tuple(settled),
    )
    return outcome if scale.passed else begin_segment(outcome, local_map)


def begin_segment(outcome: Outcome, local_map: Map) -> Outcome:
    """Begins a new segment at a keyframe that has lost the scale: its unit is the length of that newest part of the
    window by which the depths of the points that the keyframe observes are known best."""
    counts = range(min(NEWEST_KEYFRAMES, len(local_map.keys)), len(local_map.keys) + 1)
    windows = [newest_keyframes(local_map, count) for count in counts]
    uncertain = [uncertainty_of(window) for window, _ in windows]
    best = min(range(len(windows)), key=lambda i: uncertain[i].depth_sigma)
    (local_map, settled), uncertainty = windows[best], uncertain[best]
    lost = replace(outcome.decisions[-1], consequence="a new segment begins here, with a unit of its own")
    return replace(
        outcome,
        map=local_map,
        restarted=True,
        segment=None,
        decisions=(*outcome.decisions[:-1], lost),
        covariance=uncertainty.pose,
        uncertainty=uncertainty,
        settled=(*outcome.settled, *settled),
    )


def uncertainty_of(local_map: Map) -> MapUncertainty:
    """Returns the uncertainty of a map as it is."""
    problem = bundle_problem(local_map)
    return MapUncertainty.of(problem.window, tuple(k.time_ns for k in local_map.keys), problem.ids, local_map.loss)


def check_scale(before: tuple[float, ...], uncertainty: MapUncertainty, joined: bool = False) -> Decision:
    """Checks that a keyframe has the scale of its segment, by its `depth_sigma` and those `before` of the window's
    keyframes; see ModernMonocularState.depth_sigmas.

    A scale that was known must not become uncertain; that of a segment that was `joined` with an earlier one was known
    there. That of a young map, by few images, may become known later: until then each step must have a length that is
    known from nothing.
    """
    known, now = min(before, default=np.inf), uncertainty.depth_sigma
    if known > MAX_SCALE_GROWTH and not joined:
        unknown = now if now <= MAX_SCALE_GROWTH else max(now, uncertainty.scale_sigma)
        return checks.SCALE_KNOWN.of(100 * unknown, 100 * UNKNOWN_SCALE)
    return checks.SCALE_KNOWN.of(100 * np.sqrt(max(now**2 - known**2, 0.0)), 100 * MAX_SCALE_GROWTH)
