"""Starts a new segment: without observations that connect a pair to those before, neither the window nor the trajectory
may span the gap."""

from __future__ import annotations

from dataclasses import replace

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.view import Table


def start_new_segment(state: ModernIntegratedState, time_ns: int) -> ModernIntegratedState:
    """Returns the state before a pair at this time that begins a segment: rig and lens estimates stay, poses and points
    do not. Of the views that leave, those with metric poses keep them."""
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
    """Removes all views; the rig estimate from them becomes the prior."""
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
