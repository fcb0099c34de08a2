"""Compares GNSS fixes with the path of the images: clock, lever arm, unit, and exchanged axes.

The path is aligned with the fixes piece by piece, as images drift. A lever arm shows where the rig turns, a clock
offset where the velocity changes. A path in a plane fits its mirror image if it is turned over, so up must be known:
from the accelerometer, or else from cameras that are upright.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.samples import Path
from ispom.geometry import Array, rotation_between, so3_exp

from .fit import Fit, Problem, fitted, loss

NUMBERS = ("clock_s", "arm_x", "arm_y", "arm_z", "log_unit")
"""How late the stamps are [s]; antenna in the rig, true minus stated [m]; logarithm of the measured lengths over the
true ones, where the images are metric, else of the unit of the images."""
STEPS = np.array([0.01, 0.01, 0.01, 0.01, 1e-3])
WIDEST = np.array([2.0, 5.0, 5.0, 5.0, 10.0])
PIECE_S, PIECE_FIXES = 40.0, 8
"""Least duration of a piece of the path [s], and its least number of fixes: pairs of cameras drift by 1 m in 100 m, and
less in a piece that is aligned with the fixes."""
TILT_UPRIGHT, TILT_MEASURED = 0.3, 0.03
"""Standard deviations of up in the world of the images [rad]: of cameras that a person or a vehicle holds upright, and
by the accelerometer."""
OF_PIECE, DRIFT_RAD_S = 7, 1e-3
"""Numbers of a piece, and the standard deviation with which the heading of images drifts within it [rad/s]: 0.6 degrees
in 10 s."""
LATEST_S, OFFSETS = 1.0, 21
"""Clocks from which a fit starts."""
AS_GOOD = 10.0
"""Difference of losses from which on another explanation is better: e^10 times as likely."""
EXCHANGED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
"""East and north."""


@dataclass(frozen=True, eq=False)
class Fixes:
    """N fixes within the path."""

    path: Path
    times_s: Array
    """(N,)"""
    xyz: Array
    """(N, 3) in the local frame [m]."""
    sigma: Array
    """(3,) of the axes relative to each other."""
    arm: Array
    """(3,) antenna in the rig, as stated [m]."""
    piece: NDArray[np.intp]
    """(N,) number of its piece."""
    level: Array
    """(3, 3) from the world of the images to one whose z axis is up."""
    metric: bool
    """Whether the unit of the path is the metre, so that a wrong unit of the fixes is that of the lever arm, too."""

    @property
    def pieces(self) -> int:
        return int(self.piece.max()) + 1

    def residuals(self, values: Array) -> Array:
        """Returns (N, 3), of numbers (5 + 7 P,): of each piece a place, a rotation, and its drift follow."""
        t = np.clip(self.times_s - values[0], self.path.times_s[0], self.path.times_s[-1])
        rotations = self.path.rotations_at(t)
        assert rotations is not None
        # The path is extrapolated beyond both ends, so that a clock offset can be larger than the time left there.
        beyond = (self.times_s - values[0] - t)[:, None] * self._end_speeds(t)
        seen = self.path.positions_at(t) + beyond
        size = np.exp(values[4])
        arm = (size if self.metric else 1.0) * (self.arm + values[1:4])
        antenna = (size * seen + rotations @ arm) @ self.level.T
        own = values[5:].reshape(-1, OF_PIECE)[self.piece]
        flat, tilt_and_heading = np.array([1.0, 1.0, 0.0]), own[:, 3:6].copy()
        tilt_and_heading[:, 2] += own[:, 6] * self.since_s
        turned = so3_exp(tilt_and_heading * (1 - flat)) @ so3_exp(tilt_and_heading * flat)  # heading after tilt
        laid = np.einsum("nij,nj->ni", turned, antenna) + own[:, :3]
        return (laid - self.xyz) / self.sigma

    @cached_property
    def since_s(self) -> Array:
        """(N,) seconds since the middle of the piece."""
        middles = np.array([self.times_s[self.piece == k].mean() for k in range(self.pieces)])
        return self.times_s - middles[self.piece]

    def _end_speeds(self, t: Array) -> Array:
        path, wide = self.path, max(1, len(self.path) // 50)
        ends = [
            (path.positions[b] - path.positions[a]) / (path.times_s[b] - path.times_s[a])
            for a, b in ((0, wide), (-1 - wide, -1))
        ]
        return np.where((t <= path.times_s[0])[:, None], ends[0], ends[1])


def fixes(
    path: Path, times_s: Array, xyz: Array, sigma: Array, arm: Array, up: Array | None, metric: bool
) -> Fixes | None:
    """Returns the fixes within a path; None where there are too few.

    `up` (3,) in the world of the images by the accelerometer; None: where the rig's y axis points down on average.
    """
    inside = path.inside(times_s)
    if inside.sum() < PIECE_FIXES or path.rotations is None:
        return None
    times_s, xyz, sigma = times_s[inside], xyz[inside], sigma[inside]
    towards = -path.rotations[:, :, 1].mean(axis=0) if up is None else up
    level = rotation_between(towards, np.array([0.0, 0.0, 1.0]))
    count = max(1, min(int((times_s[-1] - times_s[0]) // PIECE_S), len(times_s) // PIECE_FIXES))
    edges = np.linspace(times_s[0], times_s[-1], count + 1)[1:-1]
    axes = np.median(sigma, axis=0)
    piece = np.searchsorted(edges, times_s, side="right")
    _, piece = np.unique(piece, return_inverse=True)
    return Fixes(path, times_s, xyz, axes / axes[0], arm, piece, level, metric)


@dataclass(frozen=True, eq=False)
class GnssFit:
    """The numbers (`NUMBERS`, and those of the pieces) that fit best."""

    fixes: Fixes
    fit: Fit
    exchanged: bool
    """Whether they fit only with exchanged axes."""
    axes_known: bool
    """Whether the path determines the axes."""


def gnss_fit(seen: Fixes, up_measured: bool) -> GnssFit:
    """Returns the fit that is nearest to the stated numbers, of those that are equally good."""
    found = list[tuple[Fixes, Fit]]()
    for onto in (np.eye(3), EXCHANGED):
        turned = replace(seen, xyz=seen.xyz @ onto.T)
        problem = _problem(turned, up_measured)
        fits = [fitted(problem, start) for start in _starts(turned)]
        scale = np.min([fit.scale for fit in fits], axis=0)
        losses = [loss(problem.residuals(fit.values) / scale) + problem.prior(fit.values)[2] for fit in fits]
        good = [fit for fit, each in zip(fits, losses, strict=True) if each <= min(losses) + AS_GOOD]
        found.append((turned, min(good, key=lambda fit: abs(float(fit.values[0])))))
    scale = np.min([fit.scale for _, fit in found], axis=0)
    costs = [loss(fit.problem.residuals(fit.values) / scale) + fit.problem.prior(fit.values)[2] for _, fit in found]
    exchanged = costs[1] < costs[0] - AS_GOOD
    chosen, fit = found[int(exchanged)]
    return GnssFit(chosen, fit, exchanged, abs(costs[0] - costs[1]) > AS_GOOD)


def _problem(seen: Fixes, up_measured: bool) -> Problem:
    tilt = TILT_MEASURED if up_measured else TILT_UPRIGHT
    widest = np.concatenate([WIDEST, np.tile([1e5, 1e5, 1e5, tilt, tilt, 10.0, DRIFT_RAD_S], seen.pieces)])
    steps = np.concatenate([STEPS, np.tile([0.1] * 3 + [1e-4] * 3 + [1e-5], seen.pieces)])
    return Problem(seen.residuals, steps, widest)


def _starts(seen: Fixes) -> list[Array]:
    """Returns numbers with each piece aligned with its fixes in the plane: with the stated clock, and with the best."""
    found = []
    for late in np.linspace(-LATEST_S, LATEST_S, OFFSETS):
        start = np.zeros(5 + OF_PIECE * seen.pieces)
        start[0] = late
        lengths = []
        for k in range(seen.pieces):
            here = seen.piece == k
            t = np.clip(seen.times_s[here] - late, seen.path.times_s[0], seen.path.times_s[-1])
            mine, theirs = seen.path.positions_at(t) @ seen.level.T, seen.xyz[here]
            (turn, size), centres = _in_plane(mine, theirs), (mine.mean(axis=0), theirs.mean(axis=0))
            lengths.append(size)
            start[5 + OF_PIECE * k + 5] = turn
            onto = size * so3_exp(np.array([0.0, 0.0, turn]))
            start[5 + OF_PIECE * k : 8 + OF_PIECE * k] = centres[1] - onto @ centres[0]
        start[4] = float(np.log(np.median(lengths)))
        misfit = float(np.median(abs(seen.residuals(start))))
        found.append((misfit, start))
    stated = found[OFFSETS // 2][1]
    return [stated, min(found, key=lambda each: each[0])[1]]


def _in_plane(mine: Array, theirs: Array) -> tuple[float, float]:
    """Returns the rotation about z [rad] and the scale that lay places (N, 3) onto others."""
    a, b = ((each - each.mean(axis=0))[:, :2] for each in (mine, theirs))
    along, across = float((a * b).sum()), float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    return float(np.arctan2(across, along)), float(np.hypot(along, across) / max(float((a**2).sum()), 1e-12))
