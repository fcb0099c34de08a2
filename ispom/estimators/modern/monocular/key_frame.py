"""Decides on keyframes of the monocular estimator, and extends and optimises the map with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.adjustment import optimised
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.map import Map, adjusted, intersected
from ispom.estimators.modern.monocular.setup import INLIER, MOVING, Setup
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame, parallax_deg
from ispom.geometry import rotation_angle_rad
from ispom.numerics.places import common, places
from ispom.numerics.robust import Noise
from ispom.types import Decision

ITERATIONS = 5
"""Largest number of iterations per bundle adjustment; the next keyframe's continues from the result."""
MIN_SIGNIFICANCE = 7.5
"""Least inverse depth of a new point, in its standard deviations: its depth is then known to about 13 %, within which
bundle adjustment is close to linear."""
SURE_DEPTH, MIN_DEPTHS = 15.0, 8
"""The same for points whose depths are compared between the last two keyframes and the map, and the least number of
such points for a scale."""
MAX_DRIFT = 10.0
"""Scale drift since the start [%, 1 sigma] beyond which the report marks it; it has no other effect."""


def key_frame_tests(setup: Setup, world: Map, frame: TrackedFrame) -> tuple[Decision, ...]:
    """Returns the checks each of which, if passed, makes `frame` the next keyframe of the map; the frame must have a
    pose."""
    key = world.keys[-1]
    parallax = parallax_deg(key, frame, setup.noise.width)
    placed = key.ids[np.isfinite(world.known(key.ids)[:, 0])]
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
class Extended:
    """The map with one more keyframe."""

    map: Map
    dropped: NDArray[np.int64]
    """Tracks that do not observe a static point."""
    uncertainty: MapUncertainty
    """Uncertainty of the map."""
    scale: float | None
    decisions: tuple[Decision, ...]


@dataclass(frozen=True, eq=False)
class WithKeyFrame:
    """The map with one more keyframe, before the optimisation."""

    map: Map
    moving: NDArray[np.int64]
    """Untriangulated tracks that do not observe a static point."""


def with_key_frame(setup: Setup, world: Map, frame: TrackedFrame) -> WithKeyFrame:
    """Adds the keyframe and new points with enough parallax; existing poses and points are unchanged."""
    width, world = setup.noise.width, replace(world, keys=(*world.keys, frame))
    open_ids = frame.ids[~np.isfinite(world.known(frame.ids)[:, 0])]
    new = intersected(world, open_ids, setup.noise)
    wide = (new.parallax_rad > setup.point_parallax_rad) & (new.significance > MIN_SIGNIFICANCE)
    good = wide & (new.depth > 0) & (new.worst < INLIER * width)
    points = world.points.merged(ScenePoints(open_ids[good], new.xyz_in_world[good]))
    moving = (wide | (new.depth <= 0)) & (new.worst > MOVING * width)
    return WithKeyFrame(replace(world, points=points), open_ids[moving])


def extended(setup: Setup, world: Map, frame: TrackedFrame) -> Extended:
    """Adds the keyframe and new points with enough parallax, and runs windowed bundle adjustment."""
    known, width, f = world.points.ids, setup.noise.width, setup.camera.fx
    grown = with_key_frame(setup, world, frame)
    world, bundle, before = adjusted(grown.map.with_loss(width), width, ITERATIONS)
    world = replace(world, noise=world.noise.after(bundle, world.loss))
    outliers = before.ids[places(world.points.ids, before.ids) < 0]
    dropped = np.concatenate([grown.moving, outliers])
    size = f"{len(world.keys)} keyframes, {len(before.ids)} points, {len(bundle.distances)} observations"
    off, why = f * world.noise.sigma(setup.noise.sigma), f"{world.noise.describe(f)}, loss {f * world.loss:.2f} px wide"
    cost = checks.BUNDLE_COST.of(bundle.cost_after / max(bundle.cost_before, 1e-12), 1.0, size)
    went = (
        cost,
        *optimised(bundle.cost_before, bundle.cost_after, bundle.iterations, ITERATIONS),
        checks.OUTLIERS.of(len(outliers), len(before.ids)),
        checks.NOISE.of(off, setup.noise_px.sigma, why),
    )
    times_ns = tuple(k.time_ns for k in world.keys)
    uncertainty = MapUncertainty.of(bundle.window, times_ns, before.ids, world.loss)
    scale, drift = _scale(world, known, setup.noise, uncertainty)
    return Extended(world, dropped, uncertainty, scale, (*went, *drift, *_correction(setup, world)))


def _correction(setup: Setup, world: Map) -> tuple[Decision, ...]:
    """Reports the lens correction, if it is self-calibrated."""
    if not world.extra_sigma.any():
        return ()
    focal, radial = 100 * float(world.extra[0]), float(world.extra[1])
    limit = 300 * float(setup.extra_sigma[0]) / setup.noise.factor
    because = f"focal length {focal:+.2f} %, radial distortion {radial:+.4f}"
    return (checks.FOCAL_LENGTH.of(abs(focal), limit, because),)


def _scale(
    world: Map, known: NDArray[np.int64], noise: Noise, uncertainty: MapUncertainty
) -> tuple[float | None, tuple[Decision, ...]]:
    """Returns the scale of the last step relative to the map, and its checks. The scale is the ratio of the depths of
    points that the map had before (`known` ids) to those triangulated from the last two keyframes only."""
    against = f"{100 * uncertainty.step_scale_sigma:.2g} % in the last step alone"
    since = checks.SCALE_DRIFT.of(100 * uncertainty.scale_sigma, MAX_DRIFT, against)
    pair = replace(world, keys=world.keys[-2:])
    ids = pair.keys[0].ids
    for others in (pair.keys[1].ids, known, world.points.ids):
        ids = ids[places(others, ids) >= 0]
    found = intersected(pair, ids, noise)
    sure = (found.depth > 0) & (found.significance > SURE_DEPTH)
    if sure.sum() < MIN_DEPTHS:
        return None, (since,)
    depth = pair.poses[0].inverse().apply(world.points.xyz[world.points.places(ids)])[:, 2]
    scale = float(np.exp(np.median(np.log(np.maximum(depth[sure], 1e-12) / found.depth[sure]))))
    limit = max(3 * uncertainty.step_scale_sigma, 0.005)
    because = f"depth ratio {scale:.4f} ± {uncertainty.step_scale_sigma:.4f} of {int(sure.sum())} points"
    step = checks.STEP_SCALE.of(abs(scale - 1), limit, because)
    return scale, (step, since)
