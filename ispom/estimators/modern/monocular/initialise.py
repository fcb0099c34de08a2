"""Initialisation: waits for parallax, holds the position on pure rotation, then builds the map from two views.

If steps are too wide for a tracker, features matched between two images become tracks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.first_map import first_map, poses_outside_first_map
from ispom.estimators.modern.monocular.keyframe import check_scale
from ispom.estimators.modern.monocular.map import Map, bundle_problem
from ispom.estimators.modern.monocular.recover import continue_earlier_segment
from ispom.estimators.modern.monocular.setup import MOVING, Setup
from ispom.estimators.modern.monocular.shutter import correct_first_map
from ispom.estimators.modern.monocular.state import MIN_POINTS, ModernMonocularState, Outcome, Start
from ispom.estimators.modern.monocular.track import MIN_MATCHES
from ispom.estimators.modern.monocular.tracks import NewImage, TrackingResult, tracked_frame
from ispom.estimators.modern.rolling import RollingTracks
from ispom.estimators.modern.second_motion import second_motion
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.features.images import has_contrast
from ispom.geometry import Array, Pose
from ispom.numerics.area import area_weights, weighted_median
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.rotation import TURN_LOSS, dominant_rotation, median_displacement
from ispom.solvers.multiview.zoom import turn_and_zoom
from ispom.solvers.window.adjustment import adjust
from ispom.types import Decision, Status, TrackStatus

LEAVING_SHARE = 0.4
"""Share of the first frame's points below which a map is attempted with less parallax, before all of them are lost."""
LEAVING_PARALLAX = 0.25
"""Share of the usual parallax that such a map requires."""
STAYING_SHARE = 0.25
"""Residual motion after rotation and zoom, as a share of the usual parallax, from which the camera has translated.
Forward motion is most similar to a zoom: 117 starts on roads, on a board, in simulated streets and rooms wait for it
for 50 frames in all."""
STAYING_NOISE = 1.25
"""The same in loss widths, as a lower bound: in small images a share of the parallax is noise. Tracking errors of
`noise_px` have a median distance of 0.8 widths."""
IMPATIENT = 3.0
"""Multiple of the required parallax from which the best map is accepted even if it is ambiguous: more parallax would
not help."""
MAX_FEATURES = 2000
"""Largest number of features described in each of the two images."""


def initialise(
    setup: Setup, state: ModernMonocularState, image: NewImage
) -> tuple[ModernMonocularState, NewImage, Outcome]:
    """Processes one frame without a map. After a loss, the frame may match a keyframe of an earlier segment; otherwise
    frames are collected until two of them give a first map.

    Also returns the state and the image used, which may have more tracks.
    """
    state, outcome = continue_earlier_segment(setup, state, image)
    if outcome is None:
        state, image = with_matched_features(setup, state, image)
        outcome = _collect(setup, state, image)
    return state, image, outcome


def _collect(setup: Setup, state: ModernMonocularState, image: NewImage) -> Outcome:
    """Adds one frame to the initialisation, of the first map or of a new one after tracking was lost."""
    frame = tracked_frame(setup.camera, state.live, image.tracked, image.time_ns)
    start = state.start or Start(extra_sigma=setup.extra_sigma)
    if setup.camera.line_delay_s:
        start = start.with_rolling_tracks(state.live.rolling_tracks)
    progress = advance(start, frame, setup.noise, setup.start_parallax_rad)
    after_loss = start.lost is not None
    lost = after_loss and progress.start.moves
    outcome = Outcome(
        image.tracked,
        Status.LOST if lost and start.before_loss is not None else Status.INITIALISING,
        None if lost else progress.held,
        decisions=progress.decisions,
        settled=progress.settled,
    )
    if progress.map is None:
        is_reference = len(progress.start.frames) == 1
        restarted = start.joined and not progress.start.joined and not after_loss
        return replace(outcome, start=progress.start, key_frame=is_reference, restarted=restarted)
    alive = image.tracked.status == TrackStatus.ALIVE
    last = RollingTracks(image.time_ns, state.live.ids[alive], image.tracked.uv[alive])
    local_map = correct_first_map(setup, progress.map, (*start.rolling_tracks, last))
    problem = bundle_problem(local_map)
    noise = local_map.noise.after(adjust(problem.window, local_map.loss, iterations=0), local_map.loss)
    times_ns = tuple(k.time_ns for k in local_map.keys)
    uncertainty = MapUncertainty.of(problem.window, times_ns, problem.ids, local_map.loss)
    known = check_scale((), uncertainty)
    unit = (checks.UNIT_POINTS.key, checks.UNIT_SPREAD.key)
    lost_unit = any(d.key in unit and not d.passed for d in progress.decisions)
    restarted = after_loss and not start.taken_back and (lost_unit or not start.joined)
    frames = (*local_map.trajectory(), *progress.settled)
    return replace(
        outcome,
        restarted=restarted,
        segment_from_ns=min(t for t, _ in frames) if restarted else None,
        status=Status.TRACKING,
        pose=local_map.poses[-1],
        map=replace(local_map, noise=noise),
        decisions=outcome.decisions if known.passed else (*outcome.decisions, known),
        key_frame=True,
        covariance=uncertainty.pose,
        uncertainty=uncertainty,
    )


@dataclass(frozen=True, eq=False)
class Progress:
    """Result of one frame of the initialisation."""

    start: Start
    decisions: tuple[Decision, ...]
    held: Pose | None
    """The frame's pose while there is no map; None if the camera already moves and its position is unknown."""
    map: Map | None = None
    settled: tuple[tuple[int, Pose], ...] = ()


def advance(start: Start, frame: TrackedFrame, noise: Noise, min_parallax_rad: float) -> Progress:
    """Adds one frame. `noise` of a track, normalised."""
    if not start.frames:
        frame = replace(frame, world_from_camera=start.base)
        return Progress(replace(start, frames=(frame,)), (), start.base)
    reference = start.frames[0]
    ids = np.intersect1d(reference.ids, frame.ids, assume_unique=True)
    share = len(ids) / max(1, len(reference.ids))
    enough = checks.START_POINTS.of(share, LEAVING_SHARE)
    if len(ids) < MIN_POINTS:
        few = f"only {len(ids)} points are left ({MIN_POINTS} needed)"
        return _restart(start, frame, noise, replace(enough, passed=False, consequence=few))
    x1, x2 = reference.at(ids), frame.at(ids)
    rotation = dominant_rotation(x1, x2, TURN_LOSS * noise.width)
    parallax = float(np.arctan(median_displacement(rotation, x1, x2)))
    needed = min_parallax_rad * (1 if enough.passed or start.requires_full_parallax else LEAVING_PARALLAX)
    moved = checks.START_PARALLAX.of(np.degrees(parallax), np.degrees(needed), passed=parallax >= needed)
    held = Pose(start.base.rotation @ rotation.T, start.base.translation)
    frame = replace(frame, world_from_camera=held)
    waiting = replace(start, frames=(*start.frames, frame)).limited()
    tests, waits = (moved,), not moved.passed
    if moved.passed:
        tests = (moved, *_check_translation(x1, x2, noise.width, min_parallax_rad))
        waits = not tests[1].passed
    if waits:
        if not enough.passed:
            return _restart(start, frame, noise, enough, tests)
        tests = (replace(tests[0], consequence="the position is held, waiting for parallax"), *tests[1:])
        return Progress(waiting, tests, held)
    found, decisions = first_map(waiting, frame, noise, parallax > IMPATIENT * min_parallax_rad)
    if found is None and not enough.passed:
        return _restart(start, frame, noise, enough, (*tests, *decisions))
    settled = () if found is None else poses_outside_first_map(found, waiting)
    return Progress(waiting, (*tests, *decisions), None, found, settled)


def _check_translation(x1: Array, x2: Array, width: float, min_parallax_rad: float) -> tuple[Decision, ...]:
    """Checks that the camera translated between two frames with points (N, 2), and did not only rotate and zoom.

    Points are weighted by area: a small textured object that moves is no translation. If the check fails, a second
    motion is reported too. The residual is an angle of the static camera, whose focal length is estimated with its
    rotation: with a focal length that is too short, lens or shutter errors in a pan look like translation.

    `width` of the robust loss, normalised.
    """
    weights = area_weights(x1)
    staying = turn_and_zoom(x1, x2, TURN_LOSS * width, weights)
    distances = staying.distances(x1, x2)
    left = weighted_median(distances, weights) / staying.focal
    needed = max(STAYING_SHARE * min_parallax_rad, STAYING_NOISE * width / staying.focal)
    because = f"zoom {staying.zoom:.3f}, focal length {staying.focal:.0%} of the camera's"
    travel = checks.TRAVEL.of(np.degrees(left), np.degrees(needed), because)
    return (travel,) if travel.passed else (travel, second_motion(x1, x2, distances > MOVING * width, width))


def _restart(
    start: Start, frame: TrackedFrame, noise: Noise, few: Decision, others: tuple[Decision, ...] = ()
) -> Progress:
    """Restarts the initialisation with this frame as the reference, as too few of the old reference's points are
    left."""
    new, gone = start.restarted(frame, noise.width)
    again = "initialisation starts again from this frame"
    few = replace(few, consequence=f"{few.consequence}, so {again}" if few.consequence else again)
    return Progress(new, (*others, few), new.base, settled=gone)


def with_matched_features(
    setup: Setup, state: ModernMonocularState, image: NewImage
) -> tuple[ModernMonocularState, NewImage]:
    """Adds tracks from matched features if the tracker lost most of those that began in the last image; otherwise
    returns both arguments unchanged.

    The tracks start in the last image, which is the reference of the initialisation. Wrong matches agree with no camera
    motion, and do not enter the first map. Not used with a rolling shutter, which requires the velocity of each track.
    """
    start, live, alive = state.start, state.live, int(np.count_nonzero(image.tracked.status == TrackStatus.ALIVE))
    if start is None or live.grey is None or live.grey.shape != image.grey.shape or setup.camera.line_delay_s:
        return state, image
    at_reference = len(start.frames) == 1 and start.frames[0].time_ns == live.time_ns
    enough = max(setup.min_share * len(live.ids), MIN_POINTS)
    if not at_reference or alive >= enough or not has_contrast(image.grey, live.grey):
        return state, image
    before, now = (
        setup.front_end.descriptor.detect_and_describe(grey, MAX_FEATURES) for grey in (live.grey, image.grey)
    )
    pairs = setup.front_end.matcher.match(before, now)
    if len(pairs) < max(MIN_MATCHES, alive):
        return state, image
    count, here = len(pairs), before.uv[pairs[:, 0]].astype(np.float32)
    grown = live.with_new(here, live.time_ns)
    tracked = image.tracked
    tracked = TrackingResult(
        np.concatenate([tracked.uv, now.uv[pairs[:, 1]].astype(np.float32)]),
        np.concatenate([tracked.status, np.full(count, TrackStatus.ALIVE, np.uint8)]),
        np.concatenate([tracked.speed, np.zeros((count, 2), np.float32)]),
        bright=tracked.bright,
    )
    start = start.with_new_tracks(grown.ids[-count:], setup.camera.normalise(here))
    scene = np.concatenate([image.scene, np.full((count, 3), np.nan)])
    return replace(state, live=grown, start=start), replace(image, tracked=tracked, scene=scene)
