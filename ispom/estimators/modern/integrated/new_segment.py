"""A new segment: where nothing joins a pair to those before, no window may, and no trajectory is bent to meet both."""

from __future__ import annotations

from dataclasses import replace

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.view import Table


def start_new_segment(state: ModernIntegratedState, time_ns: int) -> ModernIntegratedState:
    """The state before a pair at that time that begins a segment: what is known of rig and lens stays, poses and points
    do not; of the views that leave, those that were located in metres keep their poses."""
    window = state.window
    left = [pose for view in window.views if view.located and view.metric for pose in view.poses()]
    return replace(
        state,
        window=_emptied(window),
        apart=False,
        begun_ns=state.begun_ns.appended(time_ns),
        settled=state.settled.extended(left),
    )


def _emptied(window: JointWindow) -> JointWindow:
    """Without views: what they told of the rig is what was known before."""
    told = window.rig_estimates[-1:] if window.rig.free.any() else ()
    return replace(
        window,
        views=(),
        table=Table.empty(),
        rig_estimates=told,
        truncated=bool(told),
        knots=(),
        reference=None,
    )
