"""No map yet: wait for parallax, hold the place on pure rotation, then take the best map that two views allow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.first_map import first_map, poses_outside_first_map
from ispom.estimators.modern.monocular.map import Map, bundle_problem
from ispom.estimators.modern.monocular.second_motion import second_motion
from ispom.estimators.modern.monocular.setup import MOVING, TURN_LOSS, Setup
from ispom.estimators.modern.monocular.shutter import begun_by_motions
from ispom.estimators.modern.monocular.start import MIN_POINTS, Start
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage, Outcome
from ispom.estimators.modern.monocular.tracks import tracked_frame
from ispom.estimators.modern.rolling import Sight
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.area import area_weights, weighted_median
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.rotation import dominant_rotation, median_displacement
from ispom.solvers.multiview.zoom import turn_and_zoom
from ispom.solvers.window.adjustment import adjust
from ispom.types import Decision, Status, TrackStatus

LEAVING_SHARE = 0.4
"""When fewer points of the first frame are left, a map is tried with what parallax there is, before all are gone."""
LEAVING_PARALLAX = 0.25
"""Share of the usual parallax that such a map wants."""
STAYING_SHARE = 0.25
"""Share of the usual parallax that no turn and zoom of a camera that stays where it is may explain. Forward motion is
most like a zoom: 117 starts on roads, on a board, in simulated streets and rooms wait for it for 50 frames in all."""
STAYING_NOISE = 1.25
"""At least so many widths of the loss of it: in small images a share of the parallax is noise. Errors of tracks alone,
as large as `noise_px` says, have a median distance of 0.8 widths."""
IMPATIENT = 3.0
"""With so many times the parallax wanted, the best map is taken, clearly the best or not: more will not tell."""


def begin(setup: Setup, state: ModernMonocularState, new: NewImage) -> Outcome:
    """One more frame towards the first map, or towards one after a loss."""
    frame = tracked_frame(setup.camera, state.live, new.followed, new.time_ns)
    start = state.start or Start(extra_sigma=setup.extra_sigma)
    if setup.camera.line_delay_s:
        start = start.with_sight(state.live.sight)
    found = advance(start, frame, setup.noise, setup.start_parallax_rad)
    outcome = Outcome(new.followed, Status.INITIALISING, found.held, decisions=found.decisions, settled=found.settled)
    if found.map is None:
        alone = start.joined and not found.start.joined
        return replace(outcome, start=found.start, key_frame=len(found.start.frames) == 1, restarted=alone)
    alive = new.followed.status == TrackStatus.ALIVE
    last = Sight(new.time_ns, state.live.ids[alive], new.followed.uv[alive])
    world = begun_by_motions(setup, found.map, (*start.sights, last))
    problem = bundle_problem(world)
    noise = world.noise.after(adjust(problem.window, world.loss, iterations=0), world.loss)
    times_ns = tuple(k.time_ns for k in world.keys)
    uncertainty = MapUncertainty.of(problem.window, times_ns, problem.ids, world.loss, noise.shared)
    lost_unit = any(d.key == checks.UNIT_POINTS.key and not d.passed for d in found.decisions)
    return replace(
        outcome,
        restarted=start.joined and lost_unit,
        status=Status.TRACKING,
        pose=world.poses[-1],
        map=replace(world, noise=noise),
        key_frame=True,
        covariance=uncertainty.pose,
        uncertainty=uncertainty,
    )


@dataclass(frozen=True, eq=False)
class Progress:
    """What one more frame gave."""

    start: Start
    decisions: tuple[Decision, ...]
    held: Pose | None
    """The frame's pose as long as there is no map; None where it moves already and the place is unknown."""
    map: Map | None = None
    settled: tuple[tuple[int, Pose], ...] = ()


def advance(start: Start, frame: TrackedFrame, noise: Noise, min_parallax_rad: float) -> Progress:
    """One more frame. `noise` of a track, normalised."""
    if not start.frames:
        frame = replace(frame, world_from_camera=start.base)
        return Progress(replace(start, frames=(frame,)), (), start.base)
    reference = start.frames[0]
    ids = np.intersect1d(reference.ids, frame.ids, assume_unique=True)
    share = len(ids) / max(1, len(reference.ids))
    enough = checks.START_POINTS.of(share, LEAVING_SHARE)
    if len(ids) < MIN_POINTS:
        few = f"only {len(ids)} points are left ({MIN_POINTS} needed)"
        return _restarted(start, frame, noise, replace(enough, passed=False, consequence=few))
    x1, x2 = reference.at(ids), frame.at(ids)
    rotation = dominant_rotation(x1, x2, TURN_LOSS * noise.width)
    parallax = float(np.arctan(median_displacement(rotation, x1, x2)))
    needed = min_parallax_rad * (1 if enough.passed else LEAVING_PARALLAX)
    moved = checks.START_PARALLAX.of(np.degrees(parallax), np.degrees(needed), passed=parallax >= needed)
    held = Pose(start.base.rotation @ rotation.T, start.base.translation)
    frame = replace(frame, world_from_camera=held)
    waiting = replace(start, frames=(*start.frames, frame)).limited()
    tests, waits = (moved,), not moved.passed
    if moved.passed:
        tests = (moved, *_travelled(x1, x2, noise.width, min_parallax_rad))
        waits = not tests[1].passed
    if waits:
        if not enough.passed:
            return _restarted(start, frame, noise, enough, tests)
        tests = (replace(tests[0], consequence="the position is held, waiting for parallax"), *tests[1:])
        return Progress(waiting, tests, held)
    found, decisions = first_map(waiting, frame, noise, parallax > IMPATIENT * min_parallax_rad)
    if found is None and not enough.passed:
        return _restarted(start, frame, noise, enough, (*tests, *decisions))
    settled = () if found is None else poses_outside_first_map(found, waiting)
    return Progress(waiting, (*tests, *decisions), None, found, settled)


def _travelled(x1: Array, x2: Array, width: float, min_parallax_rad: float) -> tuple[Decision, ...]:
    """Whether points (N, 2) in two frames show that the camera travelled, and did not only turn and zoom.

    By area: something small that is full of corners and moves before a still background is no travel. Where there is
    none, what moves all the same is told. What is left is an angle of the camera that stays, whose focal length is
    found with its turn: by a given one that is too short, errors of the lens or the shutter in a pan look like travel.

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


def _restarted(
    start: Start, frame: TrackedFrame, noise: Noise, few: Decision, others: tuple[Decision, ...] = ()
) -> Progress:
    """Too few of the reference's points are left: this frame becomes the reference."""
    new, gone = start.restarted(frame, noise.width)
    again = "initialisation starts again from this frame"
    few = replace(few, consequence=f"{few.consequence}, so {again}" if few.consequence else again)
    return Progress(new, (*others, few), new.base, settled=gone)
