"""The world in which poses are given: that of the stereo method where it is followed, so that both share one drift."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ispom.estimators.modern.integrated.setup import Setup
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.view import View
from ispom.geometry import Pose
from ispom.solvers.trajectory.anchoring import anchored
from ispom.types import Trajectory


def common_pair(setup: Setup, state: ModernIntegratedState) -> View | None:
    """The last pair; where stereo is followed, of those that it located, too. Poses are given relative to it."""
    located = dict(state.metric)
    pairs = [v for v in state.window.views if not v.video]
    if setup.follow_stereo:
        pairs = [v for v in pairs if v.time_ns in located] or pairs
    return pairs[-1] if pairs else None


def stereo_from_window(setup: Setup, state: ModernIntegratedState) -> Pose:
    """What carries the window's world onto that of the stereo estimator, at the last pair of both."""
    pair, metric = common_pair(setup, state), dict(state.metric)
    if not setup.follow_stereo or pair is None or pair.time_ns not in metric:
        return Pose()
    return metric[pair.time_ns] @ pair.world_from_rig.inverse()


def video_poses(setup: Setup, poses: Sequence[tuple[int, Pose, bool]], metric: Trajectory) -> Trajectory:
    """Those of the video, up to the last pair, in the world of the stereo estimator's poses."""
    last = max((t for t, _, video in poses if not video), default=0)
    inside = [(t, pose) for t, pose, video in poses if not video or t <= last]
    own = Trajectory.of(inside)
    if setup.follow_stereo:
        own = anchored(own, metric)
    return own.select(np.isin(own.times_ns, [t for t, _, video in poses if video]))
