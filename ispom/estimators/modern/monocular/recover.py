"""Handles a frame that was not localised: holds the position on pure rotation, waits, or starts a new map."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ispom.errors import required
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.motion_model import coasted, coasted_covariance, speed_of
from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.start import MIN_POINTS, MIN_SHARED, Start
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import Followed, tracked_frame, unrolled
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.features.images import has_contrast
from ispom.geometry import Pose
from ispom.solvers.multiview.rotation import TURN_LOSS, dominant_rotation, median_displacement
from ispom.types import Decision, Status

PATIENCE = 5
"""Number of frames compared with the last localised one before a new map starts."""
SPOT_DEG = 0.5
"""Largest median residual [deg] of a pure rotation: tracks below it show no translation."""


def recover(
    setup: Setup, state: ModernMonocularState, new: NewImage, followed: Followed, failed: tuple[Decision, ...]
) -> Outcome:
    """Waits for a frame that matches the last localised one; after PATIENCE frames, or on pure rotation, starts a new
    map."""
    frame = tracked_frame(setup.camera, state.live, followed, new.time_ns)
    last_ns, last = state.recent[-1]
    before = TrackedFrame(last_ns, state.live.ids, setup.camera.normalise(unrolled(setup.camera, state.live)), last)
    turn = turned(before, frame, setup.noise.width)
    # The limit is that of a keyframe: later, too few tracks may be left to measure the rotation.
    leaving = before.common(frame) < setup.min_share * len(before.ids)
    if turn is not None and (leaving or state.missed >= PATIENCE):
        because, held = turn
        return new_start(setup, state, frame, followed, held, held, (*failed, _lost(because)))
    # A dark or covered lens cannot start a map.
    if state.missed < PATIENCE or not has_contrast(new.grey, state.live.grey):
        waiting = replace(failed[-1], consequence="the next frame is compared with the last good one")
        decisions = (*failed[:-1], waiting)
        return Outcome(followed, Status.LOST, map=state.map, decisions=decisions, missed=state.missed + 1)
    failed = (*failed[:-1], _lost(failed[-1]))
    return new_start(setup, state, frame, followed, coasted(state.recent, new.time_ns), None, failed)


def _lost(because: Decision) -> Decision:
    return replace(because, consequence="a new map starts from the last pose")


def turned(before: TrackedFrame, frame: TrackedFrame, width: float) -> tuple[Decision, Pose] | None:
    """Returns the check and the last position with the new orientation if enough tracks moved by a pure rotation."""
    ids = np.intersect1d(before.ids, frame.ids, assume_unique=True)
    if len(ids) < MIN_POINTS or before.world_from_camera is None:
        return None
    last, x1, x2 = before.world_from_camera, before.at(ids), frame.at(ids)
    turn = dominant_rotation(x1, x2, TURN_LOSS * width)
    shift = float(np.degrees(median_displacement(turn, x1, x2)))
    if shift >= SPOT_DEG:
        return None
    return checks.TURN_ONLY.of(shift, SPOT_DEG), Pose(last.rotation @ turn.T, last.translation)


def new_start(
    setup: Setup,
    state: ModernMonocularState,
    frame: TrackedFrame,
    followed: Followed,
    base: Pose,
    held: Pose | None,
    because: tuple[Decision, ...],
) -> Outcome:
    """Starts a new map at `base`, in the old world and if possible in its scale; `held` is the pose reported now."""
    world, frame = required(state.map, "there is no map to leave"), replace(frame, world_from_camera=base)
    coasting = None if held is not None else partial(coasted, state.recent)
    covariance = coasted_covariance(state.covariance, state.recent[-1][1].inverse() @ base)
    joined = held is not None and world.points.count(frame.ids) >= MIN_SHARED
    start = Start(
        (frame,),
        base,
        speed=speed_of(world),
        points=world.points,
        extra_sigma=setup.extra_sigma,
        covariance=covariance,
        coasting=coasting,
        joined=joined,
        lost=replace(world, keys=(), points=ScenePoints(), prior=None, relative_frames=()),
    )
    settled = tuple(world.trajectory())
    return Outcome(followed, Status.LOST, held, start=start, decisions=because, settled=settled, restarted=not joined)
