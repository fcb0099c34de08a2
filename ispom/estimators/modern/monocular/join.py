"""Joins segments: recognises at keyframes what earlier segments saw, measures the similarity of both worlds from the
common points, and reports the poses of the segment in the earlier world once two keyframes agree.

The estimator continues in the world of its segment; only the poses that it reports are transformed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from ispom.errors import required
from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.loops.checks import LOOP_ASKED
from ispom.estimators.modern.loops.nodes import growth
from ispom.estimators.modern.loops.output_correction import AT_ONCE, moved_step
from ispom.estimators.modern.loops.relative_pose import (
    FEWEST_SCALES,
    SURE_DEPTH,
    SURE_RAD,
    SURE_SCALE,
    ratio_of_scales,
)
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.keyframe import MAX_SCALE_GROWTH
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.match_keyframes import (
    FEATURE_ERROR,
    KeyframeMatch,
    at_middle_row_of,
    match_keyframes,
    retriangulate,
    triangulate_with_neighbours,
)
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.state import ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.tracks import NewImage
from ispom.estimators.modern.monocular.worlds import Recognised, Worlds
from ispom.estimators.modern.trials import report_accepted, report_decision, report_pose, trial
from ispom.geometry import Array, Pose, Similarity
from ispom.solvers.localisation import fit_pose
from ispom.solvers.pose_graph import FREEDOM, adjoint_sim3
from ispom.types import Decision, Step, Trajectory

VIEWS = 2
"""Number of keyframes that must agree: each has many points, and they differ in what they see."""
EVERY = 4
"""After this number of keyframes that matched no earlier one, only every EVERY-th keyframe is compared: describing one
takes as long as tracking ten frames, and a place stays in view for several keyframes."""
KEPT = 12
"""Number of the last measured similarities that are compared."""
AGREEING_DEPTHS, AGREEING_RAD = 0.1, float(np.radians(2.0))
"""Largest difference of the poses by two keyframes, in depths of the common points and in angle, besides their
covariances: the odometry between them drifts, too."""
MOST_UNLIKELY = float(chdtri(FREEDOM, 0.05))
"""Largest squared Mahalanobis distance of two measured similarities: 95 % of chi-squared."""


def join_segments(
    setup: Setup,
    before: ModernMonocularState,
    after: ModernMonocularState,
    outcome: Outcome,
    image: NewImage,
    step: Step,
) -> tuple[ModernMonocularState, Step]:
    """Compares a keyframe with earlier segments; returns the state, and the Step in the common world.

    `before` and `after` are the states before and after the frame.
    """
    since = image.time_ns if outcome.segment_from_ns is None else outcome.segment_from_ns
    worlds = after.worlds.visited(after.segment, since, len(before.settled))
    after = replace(after, worlds=worlds)
    local_map, uncertainty = after.map, after.uncertainty
    alone = worlds.root(after.segment) == after.segment > 0
    if alone and outcome.key_frame and local_map is not None and uncertainty is not None:
        after, decisions = _look_back(setup, after, local_map, uncertainty, image)
        step = replace(step, decisions=(*step.decisions, *decisions))
        if after.worlds.join_of(after.segment) is not None:
            # From here on, the unit is that of the earlier segment.
            after = replace(after, depth_sigmas=(uncertainty.depth_sigma,))
            step = replace(step, joins=after.worlds.root(after.segment))
    return _in_common_world(after, step) if after.worlds.joined else (after, step)


def in_common_world(worlds: Worlds, poses: Trajectory) -> Trajectory:
    """Returns all poses, those of joined segments in the earlier worlds."""
    return worlds.correction.of_trajectory(poses) if worlds.joined else poses


def _look_back(
    setup: Setup, state: ModernMonocularState, local_map: Map, uncertainty: MapUncertainty, image: NewImage
) -> tuple[ModernMonocularState, tuple[Decision, ...]]:
    """Compares the newest keyframe with those of earlier segments; joins the segments if enough keyframes agree."""
    unlike = state.worlds.unlike
    later = replace(state, worlds=replace(state.worlds, unlike=unlike + 1))
    if unlike >= EVERY and unlike % EVERY:
        return later, ()
    state, recognised = _recognise(setup, state, local_map, uncertainty, image)
    if recognised is None:
        return replace(state, worlds=later.worlds), ()
    state = replace(state, worlds=replace(state.worlds, unlike=0))
    points, found = recognised
    if found is None:
        return state, (points,)
    if found.pair in setup.asked.refused:
        refused = LOOP_ASKED.of(0, 1)
        _report((found,), (refused,), joined=False)
        return state, (points, refused)
    worlds = state.worlds
    worlds = replace(worlds, recognised=(*worlds.recognised, found)[-KEPT:])
    same = [one for one in worlds.recognised if one.earlier == found.earlier and agree(one, found)]
    best = min(same, key=lambda one: one.scale_sigma)
    known = checks.JOIN_SCALE.of(100 * best.scale_sigma, 100 * MAX_SCALE_GROWTH)
    views = checks.JOIN_VIEWS.of(len(same), VIEWS)
    views = replace(views, passed=views.passed and known.passed)
    decisions = (known, views)
    if found.pair in setup.asked.accepted:
        same, best, decisions = [found], found, (known, views, LOOP_ASKED.of(1, 1))
    joins = decisions[-1].passed
    _report(same if joins else (found,), decisions, joins)
    if joins:
        worlds = worlds.joined_by(best, len(state.settled))
    return replace(state, worlds=worlds), (points, *decisions)


def _report(keyframes: Iterable[Recognised], decisions: tuple[Decision, ...], joined: bool) -> None:
    """Reports the decisions about keyframes that show an earlier segment, if trials are collected."""
    for each in keyframes:
        with trial("join", "video", *each.pair):
            for decision in decisions:
                report_decision(decision)
            if joined:
                report_accepted()


def _recognise(
    setup: Setup, state: ModernMonocularState, local_map: Map, uncertainty: MapUncertainty, image: NewImage
) -> tuple[ModernMonocularState, tuple[Decision, Recognised | None] | None]:
    """Compares the newest keyframe with some of earlier segments. Returns the state with the new descriptions, and the
    number of common points with what they measure; None if it matches none of them."""
    lens, worlds, descriptor = Lens(setup.camera, local_map.extra), state.worlds, setup.front_end.descriptor
    key = required(state.database.at(image.time_ns), "the frame is not in the database").described(descriptor)
    database = state.database.with_features(key)
    root = worlds.root(state.segment)
    earlier = KeyframeDatabase(tuple(k for k in database.keyframes if worlds.root(k.segment) < root))
    if not earlier.keyframes:
        return replace(state, database=database), None
    features = required(key.features, "the keyframe is not described")
    earlier, match = match_keyframes(setup, earlier, lens, image, features, None, 0, "join")
    for described in earlier.keyframes:
        database = database.with_features(described)
    if match is None:
        return replace(state, database=database), None
    match = retriangulate(setup, earlier, replace(local_map, keys=()), match)
    database, own = triangulate_with_neighbours(setup, database, lens, key, match.index)
    found = measure(setup, lens, match, key, own, uncertainty)
    points = checks.JOIN_POINTS.of(int(np.isfinite(own[:, 0]).sum()), FEWEST_SCALES, passed=found is not None)
    with trial("join", "video", match.views[-1][0].time_ns, key.time_ns):
        report_decision(points)
        if found is not None:
            earlier_camera = match.views[-1][0].camera_from_world
            report_pose(
                Similarity(1.0, earlier_camera) @ found.earlier_from_camera,
                found.covariance,
                found.earlier_from_camera.scale * found.depth,
            )
    return replace(state, database=database), (points, found)


def measure(
    setup: Setup, lens: Lens, match: KeyframeMatch, key: Keyframe, own: Array, uncertainty: MapUncertainty
) -> Recognised | None:
    """Measures the pose and the unit of a keyframe in an earlier world from matched points, which have the positions
    `own` (N, 3), or NaN, in its own world; None if they are too few."""
    sigma, (earlier, _) = FEATURE_ERROR * setup.noise.sigma, match.views[-1]
    x = lens.normalise(at_middle_row_of(lens.camera, key, match.uv))
    fit = fit_pose(match.xyz, x, match.world_from_camera.inverse(), sigma, INLIER * sigma)
    if fit is None:
        return None
    here, there = fit.camera_from_world.apply(match.xyz)[:, 2], key.camera_from_world.apply(own)[:, 2]
    known = fit.inliers & np.isfinite(there)
    measured = ratio_of_scales(here[known] / there[known])
    if measured is None:
        return None
    scale, scale_sigma = measured
    depth = float(np.median(there[known]))
    # A left twist of camera_from_world is a right twist of world_from_camera, with opposite sign; rho is in the
    # segment's own unit.
    own_unit = np.diag(np.repeat([1 / scale, 1.0], 3))
    covariance = np.zeros((FREEDOM, FREEDOM))
    covariance[:6, :6] = own_unit @ np.linalg.inv(fit.information) @ own_unit
    covariance += np.diag(np.array([SURE_DEPTH * depth] * 3 + [SURE_RAD] * 3 + [SURE_SCALE]) ** 2)
    # The depths are known in the unit of the earlier segment, and relative to the last step in that of its own.
    covariance[6, 6] += scale_sigma**2 + earlier.depth_sigma**2 + uncertainty.relative_depth_sigma**2
    if earlier.covariance is not None:
        way = Similarity(scale, earlier.camera_from_world @ fit.camera_from_world.inverse())
        back = adjoint_sim3(way)[:, :6]
        covariance += back @ earlier.covariance @ back.T
    return Recognised(
        key.segment,
        earlier.segment,
        Similarity(scale, fit.camera_from_world.inverse()),
        covariance,
        key.camera_from_world.inverse(),
        uncertainty.pose,
        uncertainty.scale_sigma,
        depth,
        (earlier.time_ns, key.time_ns),
    )


def agree(one: Recognised, other: Recognised) -> bool:
    """Checks that two keyframes measured the same similarity of their segment and the same earlier one."""
    if one is other:
        return True
    between = one.world_from_camera.inverse() @ other.world_from_camera
    expected = one.earlier_from_camera @ Similarity(1.0, between)
    off = expected.inverse() @ other.earlier_from_camera
    error = np.concatenate([off.pose.translation, off.pose.rotvec, [np.log(off.scale)]])
    back = adjoint_sim3(Similarity(1.0, between))
    drift = np.diag(np.array([AGREEING_DEPTHS * other.depth] * 3 + [AGREEING_RAD] * 3 + [0.0]) ** 2) / 9
    covariance = back @ one.covariance @ back.T + other.covariance + drift
    return float(error @ np.linalg.solve(covariance, error)) <= MOST_UNLIKELY


def covariance_at(
    worlds: Worlds, join: Recognised, world_from_camera: Pose, covariance: Array, scale_sigma: float
) -> Array:
    """Returns the covariance (7, 7) of the right perturbation of a pose of a joined segment in the world of its root,
    from what is known in its own world: the covariance of the pose (6, 6), and the standard deviation of ln scale."""
    between = join.world_from_camera.inverse() @ world_from_camera
    back = adjoint_sim3(Similarity(1.0, between))
    grown = growth(between, join.own_covariance, covariance, max(scale_sigma**2 - join.own_scale_sigma**2, 0.0))
    return back @ _at_join(worlds, join) @ back.T + grown


def _at_join(worlds: Worlds, join: Recognised) -> Array:
    """Returns the covariance (7, 7) of the joining keyframe in the world of the root."""
    before = worlds.join_of(join.earlier)
    if before is None:
        return join.covariance
    back = adjoint_sim3(Similarity(1.0, before.world_from_camera.inverse()) @ join.earlier_from_camera)
    return back @ _at_join(worlds, before) @ back.T + join.covariance


def _in_common_world(state: ModernMonocularState, step: Step) -> tuple[ModernMonocularState, Step]:
    """Moves a Step to the world of the root of its segment, and revises some of the poses before the last join."""
    worlds, again = state.worlds.next_pending(AT_ONCE)
    earlier = state.settled.part(again.start, again.stop)
    if step.joins is not None and state.map is not None:
        earlier = [*earlier, *state.map.trajectory()]
    join, of_camera, pose = worlds.join_of(state.segment), None, step.world_from_frame
    if join is not None and pose is not None and step.covariance is not None and state.uncertainty is not None:
        of_camera = covariance_at(worlds, join, pose, step.covariance, state.uncertainty.scale_sigma)
    moved = moved_step(step, worlds.root_from(state.segment), worlds.correction, earlier, of_camera, Pose())
    if join is None:
        moved = replace(moved, covariance=step.covariance, scale_sigma=step.scale_sigma)
    return replace(state, worlds=worlds), moved
