"""Shows the fit of a segment (section 6.3; Fig. 7) stage by stage, each with the remaining error at its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ispom.geometry import Pose, rotation_angle_rad, rotation_between, so3_exp
from ispom.solvers.trajectory.segment import fit_rotations
from ispom.types import SegmentFit, Trajectory

Kind = Literal["given", "bracketed", "scaled", "turned", "oriented"]


@dataclass(frozen=True, eq=False)
class Stage:
    """The video's segment in the metric world after one stage."""

    kind: Kind
    poses: Trajectory
    """world_from_video inside the segment. For `given` and `bracketed` it also has the two poses outside that bracket
    the segment's ends."""
    ends: Trajectory
    """Two poses, at the times of the stereo frames."""
    gap_m: float
    """Distance of the segment's end from the stereo pose there."""
    direction_rad: float
    """Angle between the segment's vector and that of the stereo poses."""
    orientation_rad: float
    """Angle of the rotation from the segment's last orientation to the stereo one."""


def stages(fit: SegmentFit) -> tuple[Stage, ...]:
    """Returns the stages given, bracketed, scaled, turned and oriented; only the first two without a scale.

    The two worlds are unrelated, so the first poses are aligned from the start, with the video's unit as metres. Empty
    if the fit's arrays are empty.
    """
    if not len(fit.video) or len(fit.own_ends) < 2 or len(fit.metric_ends) < 2:
        return ()
    whole, ends, metric = fit.video, fit.own_ends, fit.metric_ends
    start, goal = metric.pose(0), metric.pose(1)
    turned = start.rotation @ ends.rotations[0].T
    onto = Pose(turned, start.translation - turned @ ends.translations[0])
    whole, ends = whole.moved(left=onto), ends.moved(left=onto)
    found = [_stage("given", whole, ends, goal), _stage("bracketed", whole, ends, goal)]
    if fit.scale is None:
        return tuple(found)
    inside = (whole.times_ns >= fit.span_ns[0]) & (whole.times_ns < fit.span_ns[1])
    poses, scaled_ends = (_scaled(each, start, fit.scale) for each in (whole.select(inside), ends))
    found.append(_stage("scaled", poses, scaled_ends, goal))
    way, wanted = scaled_ends.translations[1] - start.translation, goal.translation - start.translation
    turn = rotation_between(way, wanted)
    poses, turned_ends = (_turned(each, start, turn) for each in (poses, scaled_ends))
    found.append(_stage("turned", poses, turned_ends, goal))
    first, last = turned_ends.pose(0), turned_ends.pose(1)
    both = (fit_rotations(each, first, last, start, goal, fit.span_ns)[0] for each in (poses, turned_ends))
    poses, oriented_ends = (
        Trajectory(each.times_ns, rotations, each.translations, each.frame)
        for each, rotations in zip((poses, turned_ends), both, strict=True)
    )
    return (*found, _stage("oriented", poses, oriented_ends, goal))


def _scaled(poses: Trajectory, start: Pose, scale: float) -> Trajectory:
    translations = start.translation + scale * (poses.translations - start.translation)
    return Trajectory(poses.times_ns, poses.rotations, translations, poses.frame)


def _turned(poses: Trajectory, start: Pose, turn: np.ndarray) -> Trajectory:
    """Rotates the positions only, as orientations have their own correction."""
    translations = start.translation + (poses.translations - start.translation) @ turn.T
    return Trajectory(poses.times_ns, poses.rotations, translations, poses.frame)


def _stage(kind: Kind, poses: Trajectory, ends: Trajectory, goal: Pose) -> Stage:
    start, end = ends.translations
    way, wanted = end - start, goal.translation - start
    lengths = float(np.linalg.norm(way)), float(np.linalg.norm(wanted))
    turn = rotation_between(way, wanted) if min(lengths) > 0 else so3_exp(np.zeros(3))
    return Stage(
        kind,
        poses,
        ends,
        float(np.linalg.norm(end - goal.translation)),
        float(rotation_angle_rad(turn)),
        float(rotation_angle_rad(goal.rotation @ ends.rotations[1].T)),
    )
