"""Collects the raw observations of one frame, and the calibration corrections of the methods that this one depends
on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.view import View
from ispom.estimators.modern.rolling import late_s
from ispom.types import Rig, Status, Step, Tracks, TrackStatus


def observed(rig: Rig, part: Step, video: bool) -> View:
    """Returns the view of the live tracks of a Step; tracks of a pair require a disparity. A frame that the method
    could not localise has none: after a cut its tracks are random matches."""
    name = "video" if video else "left"
    camera, tracks = rig.camera(name), part.tracks.get(name, Tracks.of(np.zeros(0), np.zeros((0, 2))))
    alive = (tracks.status < TrackStatus.LOST) & (part.status != Status.LOST)
    if not video:
        alive &= tracks.disparity_px > 0
    order = np.flatnonzero(alive)[np.argsort(tracks.ids[alive], kind="stable")]
    seen = camera.normalise(tracks.uv[order].astype(float))
    late = late_s(camera, tracks.uv[order, 1].astype(float)) if camera.line_delay_s else None
    if video:
        return View(part.time_ns, True, 2 * tracks.ids[order], seen, np.full(len(order), np.nan), late)
    disparity = tracks.disparity_px[order].astype(float) / camera.fx
    motion = part.calibration.pair_motion
    rate = np.zeros(6) if motion is None else motion
    return View(part.time_ns, False, 2 * tracks.ids[order] + 1, seen, disparity, late, rate=rate)


def with_video(state: ModernIntegratedState, part: Step) -> ModernIntegratedState:
    """Adds the interval up to this frame, and the lens correction of the monocular method."""
    state = replace(state, interval=state.interval.after(part.time_ns))
    lens = part.calibration.lens
    if lens is None:
        return state
    state = replace(state, lens=(lens.values, lens.covariance))
    return replace(state, window=with_lens(state)) if state.window.reference is None else state


def with_lens(state: ModernIntegratedState) -> JointWindow:
    """Returns the window with the latest lens correction of the monocular method."""
    if state.lens is None:
        return state.window
    return replace(state.window, lens_correction=state.lens[0], lens_covariance=state.lens[1])


def with_stereo(state: ModernIntegratedState, part: Step) -> ModernIntegratedState:
    """Updates the stereo method's poses in the window, and its corrections of the pair: both methods have one scale."""
    if part.calibration.pair is not None:
        state = replace(state, window=replace(state.window, pair_errors=part.calibration.pair.values))
    known = dict(state.metric)
    known |= {t: pose for t, pose in part.revised.items() if t in known}
    if part.world_from_frame is not None:
        known[part.time_ns] = part.world_from_frame
        state = replace(state, metric_covariance=part.covariance)
    return replace(state, metric=tuple(sorted(known.items(), key=lambda item: item[0])))
