"""The influence of tracks, keyframes and the prior on the newest pose of a window.

To first order the pose moves by one Newton step of the remaining problem: H_r^-1 g_p, where g_p is the gradient of the
part that is left out (its points eliminated) and H_r the curvature of all others. The curvature is the loss's own, as
the weights of the others change too. Single tracks are left out by the first two terms of the series
H_r^-1 = H^-1 + H^-1 H_p H^-1 + ..., which needs no factorisation for each. Larger parts (a group of tracks, a keyframe,
the prior) are left out at once, and the step is repeated: one step overestimated the influence of groups of a fifth of
all tracks by up to a factor of three.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, skew
from ispom.numerics.places import places
from ispom.numerics.twist import twist_of
from ispom.solvers.influence.problem import Part, Shift
from ispom.solvers.window.adjustment import Equations, Window, adjust
from ispom.solvers.window.covariance import inverse_curvature
from ispom.solvers.window.kernels import OWN_CURVATURE
from ispom.solvers.window.prior import POSE, Prior
from ispom.solvers.window.scores import score_changes, track_scores
from ispom.types import FrameName

CONVERGED_DECREASE = 1e-10
"""Relative decrease of the cost at which the steps of `really` end."""
MAX_STEPS = 100
"""Largest number of steps of `really`."""
MAX_STEPS_FROM_SOLUTION, CONVERGED_FROM_SOLUTION = 15, 1e-7
"""The same for a part that is left out from the solution on."""
MIN_VIEWS = 2
"""Least number of keyframes that observe a point."""
PRIOR = "earlier keyframes"


@dataclass(frozen=True, eq=False)
class WindowProblem:
    """A window of keyframes that was optimised."""

    start: Window
    """The window before the optimisation."""
    solved: Window
    """The window after it, with the same observations."""
    scale: float
    """Width of the loss, normalised."""
    ids: NDArray[np.int64]
    """(M,) ids of the points' tracks, ascending."""
    times_ns: tuple[int, ...]
    """Times of the keyframes."""
    frame: FrameName

    @property
    def pose(self) -> Pose:
        return _newest(self.solved)

    @property
    def parts(self) -> tuple[Part, ...]:
        tracks = [Part("track", tracks=(int(i),)) for i in self.ids]
        frames = [Part("frame", time_ns=t) for t in self.times_ns[self._anchors : -1]]
        return (*tracks, *frames, *[Part("prior", PRIOR)] * (self.solved.prior is not None))

    @property
    def _anchors(self) -> int:
        """Number of first keyframes that cannot be left out: the one that fixes the world, if it is the only one."""
        prior = self.solved.prior
        return 1 if prior is None or len(prior.rotations) == 1 else 0

    def shifts(self, parts: tuple[Part, ...]) -> list[Shift]:
        return [self._shift(part) for part in parts]

    def really(self, part: Part) -> Shift:
        windows = self.start, self._without(self.start, part)
        whole, found = (_newest(adjust(window, self.scale, MAX_STEPS, CONVERGED_DECREASE).window) for window in windows)
        return _from(found, whole)

    def seen(self) -> tuple[NDArray[np.int64], Array]:
        window, at = self.solved, np.full((len(self.ids), 2), np.nan)
        now = window.cameras == len(window.rotations) - 1
        at[window.owners[now]] = window.seen[now, :2]
        return self.ids, at

    def _shift(self, part: Part) -> Shift:
        if part.kind == "track":
            (row,) = places(self.ids, np.array(part.tracks))
            return Shift.of_twist(self.pose, -self._alone[row])
        without = self._without(self.solved, part)
        without = adjust(without, self.scale, MAX_STEPS_FROM_SOLUTION, CONVERGED_FROM_SOLUTION).window
        return _from(_newest(without), self._converged)

    @cached_property
    def _converged(self) -> Pose:
        """Returns the newest pose after convergence: the method may have ended its optimisation earlier."""
        return _newest(adjust(self.solved, self.scale, MAX_STEPS_FROM_SOLUTION, CONVERGED_FROM_SOLUTION).window)

    @cached_property
    def _alone(self) -> Array:
        """Returns the left twists (M, 6) of the newest pose without each track."""
        window = self.solved
        own = Equations.of(window, self.scale, second_order=OWN_CURVATURE)
        inverse = inverse_curvature(own.symmetric, Equations.of(window, self.scale).symmetric)
        scores = track_scores(window.observed, own.eliminated, len(window.extra), self.scale)
        every, moved = np.arange(len(self.ids)), scores @ inverse
        changes = score_changes(window.observed, own.eliminated, self.scale, OWN_CURVATURE, every, moved)
        last = POSE * len(window.rotations)
        return (scores + changes) @ inverse[:, last - POSE : last]

    def _without(self, window: Window, part: Part) -> Window:
        """Returns the window without the part."""
        if part.kind == "prior":
            return replace(window, prior=_gauge_alone(window))
        if part.kind == "frame":
            keep = window.cameras != self.times_ns.index(part.time_ns or 0)
        else:
            gone = np.zeros(len(self.ids), bool)
            gone[places(self.ids, np.array(part.tracks, np.int64))] = True
            keep = ~gone[window.owners]
        views = np.bincount(window.owners[keep], minlength=len(window.points))
        keep &= (views >= MIN_VIEWS)[window.owners]
        return only(window, keep)


def only(window: Window, keep: NDArray[np.bool_]) -> Window:
    """Returns the window with the observations of the mask (K,) only, and their points."""
    used = np.zeros(len(window.points), bool)
    used[window.owners[keep]] = True
    return replace(
        window,
        points=window.points[used],
        cameras=window.cameras[keep],
        owners=(np.cumsum(used) - 1)[window.owners[keep]],
        seen=window.seen[keep],
        factors=window.factors[keep] if window.baseline else window.factors,
    )


def _newest(window: Window) -> Pose:
    return Pose(window.rotations[-1], window.translations[-1]).inverse()


def _from(before: Pose, after: Pose) -> Shift:
    """Returns the shift from one world_from_camera to another."""
    return Shift(after.translation - before.translation, twist_of(after.inverse() @ before)[3:])


def _gauge_alone(window: Window) -> Prior | None:
    """Returns the prior that only fixes the gauge: position, orientation and, for one camera, the scale of the window,
    which no observation determines. The corrections keep the standard deviations of their calibration."""
    prior = window.prior
    if prior is None:
        return None
    poses, size = len(prior.rotations), len(prior.hessian)
    free = np.zeros((size, 6 if window.baseline else 7))
    for i, (rotation, translation) in enumerate(
        zip(window.rotations[:poses], window.translations[:poses], strict=True)
    ):
        centre, rows = -rotation.T @ translation, slice(POSE * i, POSE * i + 3)
        free[rows, :3], free[rows, 3:6] = -rotation, rotation @ skew(centre)
        free[POSE * i + 3 : POSE * i + 6, 3:6] = -rotation
        if not window.baseline:
            free[rows, 6] = -rotation @ centre
    held = prior.hessian @ free
    gain = held @ np.linalg.pinv(free.T @ held, rcond=1e-12, hermitian=True)
    hessian, gradient = gain @ held.T, gain @ (free.T @ (prior.gradient + prior.hessian @ window.shift))
    for i in np.flatnonzero(window.extra_sigma > 0):
        at = POSE * poses + int(i)
        hessian[at, at] += window.extra_sigma[i] ** -2
        gradient[at] += window.extra[i] / window.extra_sigma[i] ** 2
    return Prior(window.rotations[:poses], window.translations[:poses], window.extra, hessian, gradient)
