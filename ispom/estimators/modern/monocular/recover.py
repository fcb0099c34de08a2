"""Handles a frame that its tracks do not localise: relocalises it among the keyframes, or starts a new map at once,
holding the position on pure rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern import trials
from ispom.estimators.modern.keyframe_database import FEATURES, Keyframe
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.keyframe import (
    add_keyframe,
)
from ispom.estimators.modern.monocular.localise import (
    MIN_DESCRIBED,
    Localisation,
    align_with_map,
    is_contradicted,
    localise_by_tracks,
    without_outliers,
)
from ispom.estimators.modern.monocular.map import Map, TracksInMap
from ispom.estimators.modern.monocular.match_keyframes import (
    MIN_INLIERS,
    KeyframeMatch,
    at_middle_row_of,
    match_keyframes,
    retriangulate,
)
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.state import MIN_POINTS, MIN_SHARED, ModernMonocularState, Outcome, Start
from ispom.estimators.modern.monocular.track import predict_covariance, predict_pose
from ispom.estimators.modern.monocular.tracks import (
    LiveTracks,
    NewImage,
    TrackingResult,
    at_middle_row,
    tracked_frame,
    tracks_with_speeds,
)
from ispom.estimators.modern.monocular.window import (
    prior_of_keyframes,
)
from ispom.estimators.modern.trials import judged, trial
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.features.images import has_contrast
from ispom.geometry import Array, Pose
from ispom.solvers.multiview.rotation import TURN_LOSS, dominant_rotation, median_displacement
from ispom.types import Decision, Status, TrackStatus

PATIENCE = 5
"""Number of frames after a loss that are tracked from the last localised one, too, while a new map is being started."""
MAX_ROTATION_RESIDUAL_DEG = 0.5
"""Largest median residual [deg] of a pure rotation: tracks below it show no translation."""


@dataclass(frozen=True, eq=False)
class NotLocalised:
    """A frame that neither its tracks nor keyframes localise."""

    tracked: TrackingResult
    decisions: tuple[Decision, ...]
    """The last one is the check that failed."""


@dataclass(frozen=True, eq=False)
class Relocalisation:
    """A relocalised frame, with the state and the map in which it is localised."""

    state: ModernMonocularState
    """The state with the matched features as tracks."""
    map: Map
    localisation: Localisation
    segment: int
    """The segment of the matched keyframe."""
    keyframe_ns: int
    """Time of the matched keyframe."""


def relocalise(
    tracks: TracksInMap, state: ModernMonocularState, image: NewImage, localisation: Localisation
) -> tuple[ModernMonocularState, Relocalisation | None, Decision]:
    """Relocalises the frame in the last localised image and in keyframes, if that gives more inliers than its tracks
    did, which do not contradict it.

    Returns the state with the new descriptions, the relocalisation, and the number of points as a decision.
    """
    state, relocalisation = _relocalise_in_old_images(tracks.setup, state, tracks.map, image)
    if relocalisation is not None and (
        relocalisation.localisation.count <= localisation.count
        or is_contradicted(tracks, localisation, relocalisation.localisation)
    ):
        with trial("relocalisation", "video", relocalisation.keyframe_ns, image.time_ns):
            judged(False, trials.BETTER, relocalisation.localisation.count, localisation.count)
        relocalisation = None
    described = 0 if relocalisation is None else len(relocalisation.state.live.ids) - len(state.live.ids)
    return state, relocalisation, checks.DESCRIBED_POINTS.of(described, MIN_INLIERS)


def _relocalise_in_old_images(
    setup: Setup, state: ModernMonocularState, local_map: Map, image: NewImage
) -> tuple[ModernMonocularState, Relocalisation | None]:
    """Relocalises the frame in the last localised image and in keyframes."""
    (last_ns, last), grey = state.recent[-1], state.live.grey
    if not setup.relocalise or grey is None or not has_contrast(image.grey, grey):
        return state, None
    moving = tracks_with_speeds(setup.camera, state.live.uv, state.live.speed)
    newest = Keyframe.of(last_ns, last.inverse(), (grey,), None, moving=moving, segment=state.segment)
    known = state.database.at(last_ns) or state.last_localised
    before = newest if known is None or known.time_ns != last_ns else known
    before = before.described(setup.front_end.descriptor)
    state = replace(state, last_localised=before)
    return _relocalise(setup, state, local_map, image, before, state.missed)


def _relocalise_after_loss(
    setup: Setup, state: ModernMonocularState, image: NewImage
) -> tuple[ModernMonocularState, Relocalisation | None]:
    """Relocalises a frame in the keyframes of earlier segments, before the new map exists."""
    start, live = state.start, state.live
    if start is None or start.lost is None or start.before_loss is not None or not setup.relocalise:
        return state, None
    if not state.database.keyframes:
        return state, None
    if live.grey is None or not has_contrast(image.grey, live.grey):
        return state, None
    # Tracks since the loss, and guessed poses, belong to the map that was being initialised.
    earlier = replace(state, settled=state.settled.extended(start.held if start.joined else ()))
    earlier, relocalisation = relocalise_alone(setup, earlier, start.lost, image, len(start.frames))
    return replace(state, database=earlier.database), relocalisation


def relocalise_alone(
    setup: Setup, state: ModernMonocularState, local_map: Map, image: NewImage, turn: int
) -> tuple[ModernMonocularState, Relocalisation | None]:
    """Relocalises a frame in the keyframes without any track; each `turn` compares it with others of them. The state
    that is returned has the new descriptions, and no tracks."""
    live = state.live
    no_tracks = LiveTracks(live.grey, before_ns=live.before_ns, time_ns=live.time_ns, next_id=live.next_id)
    image = replace(image, scene=np.zeros((0, 3)))
    return _relocalise(setup, replace(state, live=no_tracks), local_map, image, None, turn)


def _relocalise(
    setup: Setup, state: ModernMonocularState, local_map: Map, image: NewImage, last: Keyframe | None, turn: int
) -> tuple[ModernMonocularState, Relocalisation | None]:
    """Matches the frame with keyframes; localises it by the existing tracks, searched with the pose of the match, and
    by the matched features."""
    lens = Lens(setup.camera, local_map.extra)
    features = setup.front_end.descriptor.detect_and_describe(image.grey, FEATURES)
    database, match = match_keyframes(setup, state.database, lens, image, features, last, turn)
    state = replace(state, database=database)
    if match is None:
        return state, None
    match = retriangulate(setup, database, local_map, match)
    live, pose, count = state.live, match.world_from_camera, len(match.uv)
    lost = TrackingResult(live.uv, np.full(len(live.ids), TrackStatus.LOST, np.uint8), np.zeros_like(live.uv))
    existing, compared = align_with_map(TracksInMap(setup, live, local_map), image, lost, pose)
    tracked = TrackingResult(
        np.concatenate([existing.uv, match.uv]),
        np.concatenate([existing.status, np.full(count, TrackStatus.ALIVE, np.uint8)]),
        np.concatenate([existing.speed, np.zeros((count, 2), np.float32)]),
    )
    matched, local_map = with_matched_features_of(setup, state, local_map, match)
    localisation = localise_by_tracks(TracksInMap(setup, matched.live, local_map), tracked, pose)
    keyframe, _ = match.views[-1]
    with trial("relocalisation", "video", keyframe.time_ns, image.time_ns):
        if not judged(localisation.count >= MIN_DESCRIBED, trials.LOCALISED, localisation.count, MIN_DESCRIBED):
            return state, None
        trials.report_accepted()
    localisation = replace(localisation, compared=np.concatenate([compared, np.zeros(count, bool)]))
    return state, Relocalisation(matched, local_map, localisation, keyframe.segment, keyframe.time_ns)


def with_matched_features_of(
    setup: Setup, state: ModernMonocularState, local_map: Map, match: KeyframeMatch
) -> tuple[ModernMonocularState, Map]:
    """Adds the features that the frame and the keyframes share as tracks, after the existing ones, and as points.

    Keyframes that have left the window form a new one, with the covariance that the first of them had.
    """
    live, count = state.live, len(match.uv)
    ids = live.next_id + np.arange(count, dtype=np.int64)
    if not {p.time_ns for p, _ in match.views} & {k.time_ns for k in local_map.keys}:
        state = replace(state, settled=state.settled.extended(local_map.trajectory()))
        local_map = _window_of_keyframes(setup, local_map, match)
    observed = {k.time_ns: at_middle_row_of(setup.camera, k, uv) for k, uv in match.views}
    keys = tuple(
        _with_observations(setup, k, ids, observed[k.time_ns]) if k.time_ns in observed else k for k in local_map.keys
    )
    local_map = replace(local_map, keys=keys, points=local_map.points.merged(ScenePoints(ids, match.xyz)))
    keyframe, uv = match.views[-1]
    live = live.with_new(uv.astype(np.float32), keyframe.time_ns)
    return replace(state, live=live), local_map


def _with_observations(setup: Setup, key: TrackedFrame, ids: NDArray[np.int64], uv: Array) -> TrackedFrame:
    """Adds those of the points (N,) to a keyframe that it observes, at (N, 2) [px]."""
    has = np.isfinite(uv[:, 0])
    return key.with_new(ids[has], setup.camera.normalise(uv[has]))


def _window_of_keyframes(setup: Setup, local_map: Map, match: KeyframeMatch) -> Map:
    """Returns a window of the matched keyframes, without points."""
    none = np.zeros(0, np.int64), np.zeros((0, 2))
    keyframes = sorted((k for k, _ in match.views), key=lambda k: k.time_ns)
    poses = tuple(k.camera_from_world.inverse() for k in keyframes)
    keys = tuple(TrackedFrame(k.time_ns, *none, pose) for k, pose in zip(keyframes, poses, strict=True))
    covariance = np.zeros((6, 6)) if keyframes[0].covariance is None else keyframes[0].covariance
    in_camera = keyframes[-1].camera_from_world.apply(match.xyz)
    # In the units of the cost, a loss as wide as initially corresponds to errors of `noise`.
    sigma = setup.noise.sigma
    widened, depth = local_map.loss / sigma, float(np.median(in_camera[:, 2]))
    prior = prior_of_keyframes(poses, local_map.extra_sigma, widened**2 * covariance, widened * sigma, depth)
    return replace(local_map, keys=keys, points=ScenePoints(), prior=prior, relative_frames=())


def continue_earlier_segment(
    setup: Setup, state: ModernMonocularState, image: NewImage
) -> tuple[ModernMonocularState, Outcome | None]:
    """Continues in the world of a segment before the loss, if the frame matches one of its keyframes, and these give it
    their scale.

    Also returns the state used, which has the matched features as tracks.
    """
    state, relocalisation = _relocalise_after_loss(setup, state, image)
    if relocalisation is None:
        return state, None
    matched, localisation = relocalisation.state, relocalisation.localisation
    decisions = (
        checks.DESCRIBED_POINTS.of(len(matched.live.ids), MIN_INLIERS),
        checks.POSE_POINTS.of(localisation.count, MIN_DESCRIBED),
    )
    tracks = TracksInMap(setup, matched.live, relocalisation.map)
    frame, outcome = without_outliers(tracks, image, localisation, decisions)
    outcome = replace(outcome, restarted=relocalisation.segment != state.segment, segment=relocalisation.segment)
    outcome = add_keyframe(setup, matched, outcome, frame)
    return (state, None) if outcome.segment is None else (matched, outcome)


def recover(setup: Setup, state: ModernMonocularState, image: NewImage, lost: NotLocalised) -> Outcome:
    """Starts a new map, unless the image shows nothing; the next frames are still compared with the last localised
    one."""
    tracked, failed = lost.tracked, lost.decisions
    frame = tracked_frame(setup.camera, state.live, tracked, image.time_ns)
    last_ns, last = state.recent[-1]
    before = TrackedFrame(
        last_ns, state.live.ids, setup.camera.normalise(at_middle_row(setup.camera, state.live)), last
    )
    rotation_only = check_rotation_only(before, frame, setup.noise.width)
    if rotation_only is not None:
        test, held = rotation_only
        frame = replace(frame, world_from_camera=held)
        return new_start(setup, state, tracked, frame, held, (*failed, _starts_new_map(test)))
    # A dark or covered lens cannot start a map.
    if not has_contrast(image.grey, state.live.grey):
        waiting = replace(failed[-1], consequence="the next frame is compared with the last good one")
        decisions = (*failed[:-1], waiting)
        return Outcome(tracked, Status.LOST, map=state.map, decisions=decisions, missed=state.missed + 1)
    frame = replace(frame, world_from_camera=predict_pose(state.recent, image.time_ns))
    return new_start(setup, state, tracked, frame, None, (*failed[:-1], _starts_new_map(failed[-1])))


def _starts_new_map(because: Decision) -> Decision:
    return replace(because, consequence="a new map starts from the last pose")


def check_rotation_only(before: TrackedFrame, frame: TrackedFrame, width: float) -> tuple[Decision, Pose] | None:
    """Returns the check and the last position with the new orientation if enough tracks moved by a pure rotation."""
    ids = np.intersect1d(before.ids, frame.ids, assume_unique=True)
    if len(ids) < MIN_POINTS or before.world_from_camera is None:
        return None
    last, x1, x2 = before.world_from_camera, before.at(ids), frame.at(ids)
    turn = dominant_rotation(x1, x2, TURN_LOSS * width)
    shift = float(np.degrees(median_displacement(turn, x1, x2)))
    if shift >= MAX_ROTATION_RESIDUAL_DEG:
        return None
    return checks.TURN_ONLY.of(shift, MAX_ROTATION_RESIDUAL_DEG), Pose(last.rotation @ turn.T, last.translation)


def new_start(
    setup: Setup,
    state: ModernMonocularState,
    tracked: TrackingResult,
    frame: TrackedFrame,
    held: Pose | None,
    decisions: tuple[Decision, ...],
) -> Outcome:
    """Starts a new map at the pose of the frame, in the old world and if possible in its scale; `held` is the pose
    reported now, None if the position is unknown."""
    local_map, base = required(state.map, "there is no map to leave"), frame.pose
    joined = held is not None and local_map.points.count(frame.ids) >= MIN_SHARED
    start = Start(
        (frame,),
        base,
        depth=local_map.median_depth,
        points=local_map.points,
        extra_sigma=setup.extra_sigma,
        covariance=predict_covariance(state.covariance, state.recent[-1][1].inverse() @ base)
        if joined
        else np.zeros((6, 6)),
        coasting=None if held is not None else partial(predict_pose, state.recent),
        joined=joined,
        lost=replace(local_map, keys=(), points=ScenePoints(), prior=None, relative_frames=()),
        before_loss=replace(state, missed=state.missed + 1),
    )
    settled = tuple(local_map.trajectory())
    return Outcome(tracked, Status.LOST, held, start=start, decisions=decisions, settled=settled)
