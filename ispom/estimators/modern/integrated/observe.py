"""Collects the raw observations of one frame, and the calibration corrections of the methods that this one depends
on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.state import ModernIntegratedState
from ispom.estimators.modern.integrated.window import JointWindow, View
from ispom.estimators.modern.rolling import late_s
from ispom.types import Decision, Rig, Status, Step, Tracks, TrackStatus

MIN_SHARE_MATCHED = 1 / 3
"""Least share of points with a consistent right match. Ordinary pairs have 0.5 and more, those with half of the right
image covered mostly 0.4 to 0.7. An empty right image, or one of another time or camera, leaves 0 to 0.25."""
MIN_POINTS_JUDGED = 30
"""Least number of points over which the share is computed: a few remaining ones agree by chance."""


def check_right_matches(part: Step) -> Decision:
    """Checks the pair of a Step of the stereo method.

    Without a right match a point constrains the motion, but not its length: a window of such pairs has no scale, and
    wrong matches give it a wrong one.
    """
    tracks = part.tracks.get("left", Tracks.of(np.zeros(0), np.zeros((0, 2))))
    matched, new = tracks.disparity_px > 0, tracks.status == TrackStatus.NEW
    old = tracks.status == TrackStatus.ALIVE
    judged = int((old | (tracks.status == TrackStatus.REPROJECTION)).sum())
    if judged:
        return checks.RIGHT_FITS.of(float((matched & old).sum() / max(judged, MIN_POINTS_JUDGED)), MIN_SHARE_MATCHED)
    # Where stereo begins, all points are new: there is nothing else to compare with.
    return checks.RIGHT_FITS.of(float((matched & new).sum() > 0), MIN_SHARE_MATCHED)


def observe(rig: Rig, part: Step, video: bool) -> View:
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
    return replace(state, window=with_latest_lens(state)) if state.window.reference is None else state


def with_latest_lens(state: ModernIntegratedState) -> JointWindow:
    """Returns the window with the latest lens correction of the monocular method."""
    if state.lens is None:
        return state.window
    return replace(state.window, lens_correction=state.lens[0], lens_covariance=state.lens[1])


def with_pair(state: ModernIntegratedState, part: Step) -> ModernIntegratedState:
    """Updates the stereo method's poses in the window, and its corrections of the pair: both methods have one scale."""
    return _with_stereo(replace(state, skipped=0, stereo_restarted=False), part)


def without_pair(state: ModernIntegratedState, part: Step) -> ModernIntegratedState:
    """Skips a pair that measures no depth: its pose is not used."""
    restarted = state.stereo_restarted or part.restarted
    state = replace(state, skipped=state.skipped + 1, stereo_restarted=restarted)
    return _with_stereo(state, replace(part, world_from_frame=None))


def _with_stereo(state: ModernIntegratedState, part: Step) -> ModernIntegratedState:
    if part.calibration.pair is not None:
        state = replace(state, window=replace(state.window, pair_errors=part.calibration.pair.values))
    known = dict(state.metric)
    known |= {t: pose for t, pose in part.revised.items() if t in known}
    if part.world_from_frame is not None:
        known[part.time_ns] = part.world_from_frame
        state = replace(state, metric_covariance=part.covariance)
    return replace(state, metric=tuple(sorted(known.items(), key=lambda item: item[0])))
