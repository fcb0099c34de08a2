"""World of the reported poses: that of the stereo method if it is followed, so that both share one drift."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.state import ModernIntegratedState, Setup
from ispom.estimators.modern.integrated.window import View
from ispom.geometry import Pose, rotation_angle_rad
from ispom.solvers.trajectory.anchoring import anchored, averaged
from ispom.types import Decision, Trajectory

LEAST_LENGTH_BASELINES = 0.1
"""Least length of a window, in baselines, for a ratio of lengths: below it both lengths are noise."""


def common_pair(setup: Setup, state: ModernIntegratedState) -> View | None:
    """Returns the last pair, if stereo is followed the last one that it localised. Reported poses are relative to
    it."""
    located = dict(state.metric)
    pairs = [v for v in state.window.views if not v.video]
    if setup.follow_stereo:
        pairs = [v for v in pairs if v.time_ns in located] or pairs
    return pairs[-1] if pairs else None


def stereo_from_window(setup: Setup, state: ModernIntegratedState) -> Pose:
    """Returns the transformation from the window's world to that of the stereo estimator, at the last common pair."""
    pair, metric = common_pair(setup, state), dict(state.metric)
    if not setup.follow_stereo or pair is None or pair.time_ns not in metric:
        return Pose()
    target = metric[pair.time_ns]
    if _has_rolling_shutter(setup):
        own = Trajectory.of([(v.time_ns, v.world_from_rig) for v in state.window.views if not v.video])
        target = dict(target_poses(setup, own, Trajectory.of(list(state.metric))).items())[pair.time_ns]
    return target @ pair.world_from_rig.inverse()


def target_poses(setup: Setup, own: Trajectory, metric: Trajectory) -> Trajectory:
    """Returns the target poses of the pairs: those of the stereo method.

    With a rolling shutter, stereo barely observes how a single pair moved during readout, and the video does; the
    targets are then averages over as many neighbouring pairs as the window has.
    """
    return averaged(own, metric, setup.window_pairs) if _has_rolling_shutter(setup) else metric


def _has_rolling_shutter(setup: Setup) -> bool:
    return setup.rig.camera("left").line_delay_s != 0


def pose_by_stereo(setup: Setup, state: ModernIntegratedState, view: View) -> Pose | None:
    """Returns world_from_rig of a pair that is not in the window yet, by the stereo method; None if it was not
    localised or is not followed."""
    pair, metric = common_pair(setup, state), dict(state.metric)
    if view.video or not setup.follow_stereo or pair is None or not {pair.time_ns, view.time_ns} <= metric.keys():
        return None
    return stereo_from_window(setup, state).inverse() @ metric[view.time_ns]


def report_alignment(setup: Setup, state: ModernIntegratedState) -> tuple[Decision, ...]:
    """Compares the window's pairs with stereo's poses, once aligned at the last pair; nothing for a single pair."""
    metric = dict(state.metric)
    pairs = [v for v in state.window.views if not v.video and v.time_ns in metric]
    if not setup.follow_stereo or len(pairs) < 2:
        return ()
    stereo_from_world = stereo_from_window(setup, state)
    own = np.stack([(stereo_from_world @ v.world_from_rig).translation for v in pairs])
    by_stereo = np.stack([metric[v.time_ns].translation for v in pairs])
    length, stereo_length = (float(np.linalg.norm(np.diff(xyz, axis=0), axis=1).sum()) for xyz in (own, by_stereo))
    residual_mm = 1e3 * float(np.sqrt(((own - by_stereo) ** 2).sum(axis=1).mean()))
    decisions = (
        checks.ALIGN_TURN.of(float(np.degrees(rotation_angle_rad(stereo_from_world.rotation))), 0.0),
        checks.ALIGN_RESIDUAL.of(residual_mm, 0.0),
    )
    if length < LEAST_LENGTH_BASELINES * setup.rig.baseline_m:
        return decisions
    return checks.ALIGN_SCALE.of(stereo_length / length, 0.0), *decisions


def video_poses(
    setup: Setup, poses: Sequence[tuple[int, Pose, bool]], metric: Trajectory, begun_ns: tuple[int, ...] = ()
) -> Trajectory:
    """Returns the poses of the video up to the last pair, in the world of the stereo estimator. Each segment, which
    begin at the pairs `begun_ns`, is aligned separately."""
    last = max((t for t, _, video in poses if not video), default=0)
    inside = [(t, pose) for t, pose, video in poses if not video or t <= last]
    own = Trajectory.of(inside)
    if setup.follow_stereo:
        segment = np.searchsorted(np.array(begun_ns, np.int64), own.times_ns, side="right")
        each = [own.select(segment == k) for k in range(len(begun_ns) + 1)]
        parts = [anchored(one, target_poses(setup, one, metric)) for one in each]
        own = parts[0] if not begun_ns else Trajectory.of([item for part in parts for item in part.items()])
    return own.select(np.isin(own.times_ns, [t for t, _, video in poses if video]))
