"""Chooses the knot spacing of the spline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.state import Setup
from ispom.estimators.modern.integrated.window import JointWindow, estimated_poses, times_s
from ispom.geometry import Array
from ispom.solvers.spline.curve import ORDER
from ispom.solvers.spline.fit import fitted, misfits
from ispom.types import Decision

KNOT_FRAMES = (6.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0)
"""Knot spacings to choose from, in video frames."""
USUAL_KNOT_FRAMES = 2.0
"""Knot spacing, in video frames, if the motion gives no evidence."""
MOST_DENSE = 40
"""Largest number of knots at a spacing of one frame: the time of an optimisation grows with their cube."""
MIN_FREEDOM = 2
"""Least number of degrees of freedom of a misfit."""


@dataclass(frozen=True, eq=False)
class VideoPoses:
    """The poses by which the knot spacing is chosen."""

    times_s: Array
    """(E,) times."""
    rotations: Array
    """(E, 3, 3) orientations."""
    positions: Array
    """(E, 3) positions."""
    new: NDArray[np.bool_]
    """(E,) which of them were localised since the last optimisation; N of them."""
    information: Array
    """(N, 6, 6) information of these."""

    @staticmethod
    def of(window: JointWindow) -> VideoPoses | None:
        """Returns the poses of the video; None if they are too few for a spline."""
        # Pairs are not used: a time offset would look like motion that only dense knots can follow.
        views = tuple(replace(v, located=v.located and v.video) for v in window.views)
        if sum(v.located for v in views) < ORDER:
            return None
        order, times, rotations, positions = estimated_poses(views, times_s(window.views, window.rig))
        known = [window.views[i].information for i in order]
        new = np.array([each is not None for each in known])
        information = np.array([each for each in known if each is not None]).reshape(-1, 6, 6)
        return VideoPoses(times, rotations, positions, new, information)


@dataclass(frozen=True, eq=False)
class Knots:
    """The chosen knot spacing."""

    spacing_s: float
    decisions: tuple[Decision, ...] = ()
    dense: bool = False
    """Whether the knots are as dense as the frames, because only the spline connects the pairs and the video."""


def choose_knots(setup: Setup, window: JointWindow, frame_s: float) -> tuple[JointWindow, Knots]:
    """Chooses the knot spacing; `frame_s` is the interval between two video frames.

    It is fixed by the setting, or if the rig is self-calibrated, as a wrong clock or mount looks like motion. Otherwise
    it follows the motion. The window gets the choice and the error of the spline.
    """
    if setup.knot_frames or window.rig.free.any():
        return window, Knots(_spacing_s(window, setup.knot_frames or USUAL_KNOT_FRAMES, frame_s))
    window, test = _follow_motion(window, frame_s, setup.knot_misfit)
    frames, dense = min(window.knots), len(window.pairs) == 2
    if dense:
        frames = _dense_frames(window, frames, frame_s)
        test = replace(test, consequence=f"knots every {frames:.3g} frames, which alone connect video and pairs")
    return window, Knots(_spacing_s(window, frames, frame_s), (test,), dense)


def _follow_motion(window: JointWindow, frame_s: float, max_misfit: float) -> tuple[JointWindow, Decision]:
    """Chooses the widest knot spacing whose misfit to the poses since the last optimisation is small enough."""
    chosen, misfit, poses = KNOT_FRAMES[-1], None, VideoPoses.of(window)

    @cache
    def misfit_of(frames: float) -> float | None:
        return None if poses is None else spline_misfit(poses, _spacing_s(window, frames, frame_s))

    for frames in KNOT_FRAMES[:-1]:
        latest = misfit_of(frames)
        misfit = misfit if latest is None else latest
        if latest is not None and latest <= max_misfit:
            chosen = frames
            break
    if misfit is None:
        chosen, misfit = USUAL_KNOT_FRAMES, 0.0
    # A window has one spacing: that of its fastest part.
    knots = (*window.knots, chosen)[1 - len(window.pairs) :]
    because = f"knots every {min(knots):g} frames" + ("" if chosen == min(knots) else ", because of the motion before")
    window = replace(window, knots=knots, spline_error=spline_error(misfit_of, min(knots)))
    return window, checks.SPLINE_MISFIT.of(misfit, max_misfit, because)


def spline_misfit(poses: VideoPoses, spacing_s: float) -> float | None:
    """Returns the misfit of a spline with this knot spacing to the poses localised since the last optimisation.

    It is the mean square per degree of freedom, in standard deviations of the poses; None if they are too few.
    """
    times, new = poses.times_s, poses.new
    freedom = new.sum() - (times[new].max() - times[new].min()) / spacing_s if new.any() else 0.0
    if freedom < MIN_FREEDOM:
        return None
    spline = fitted(times, poses.rotations, poses.positions, spacing_s)
    off = misfits(spline, times, poses.rotations, poses.positions)[new]
    return float(np.einsum("ei,eij,ej->", off, poses.information, off)) / (6 * float(freedom))


def spline_error(misfit_of: Callable[[float], float | None], frames: float) -> float:
    """Returns the squared error of a spline with this knot spacing in frames, in variances of the poses: the increase
    of its misfit over that of the next denser knots. Each knot absorbs a share of it.

    `misfit_of` returns the misfit at a spacing, see spline_misfit.
    """
    denser = max((f for f in KNOT_FRAMES if f < frames), default=None)
    if denser is None:
        return 0.0
    own, noise = misfit_of(frames), misfit_of(denser)
    return 0.0 if own is None or noise is None else max(own - noise, 0.0) * (1 - 1 / frames)


def _dense_frames(window: JointWindow, frames: float, frame_s: float) -> float:
    """Returns the knot spacing, in video frames, of a window with two pairs, one before and one after the video.

    Only the spline connects pairs and video there, so it must follow the whole motion: one knot a frame, up to
    MOST_DENSE knots.
    """
    span_s = (window.views[-1].time_ns - window.views[0].time_ns) * 1e-9
    return min(frames, max(KNOT_FRAMES[-1], span_s / frame_s / MOST_DENSE))


def _spacing_s(window: JointWindow, frames: float, frame_s: float) -> float:
    """Returns the knot spacing [s] for a spacing in video frames; in a thinned window, in views, as more knots would
    not be constrained."""
    if not any(v.attached for v in window.views):
        return frames * frame_s
    span_s = (window.views[-1].time_ns - window.views[0].time_ns) * 1e-9
    return frames * max(frame_s, span_s / len(window.views))
