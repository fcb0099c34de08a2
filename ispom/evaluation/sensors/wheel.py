"""Wheels against the path of the images: clock, mount, and the units of way and rotation.

Wheels roll along their x axis and do not slide sideways: in the frame where that holds, the motion of the images has no
y. A mount that is turned about the vertical axis shows on any way, a place ahead of the axle where the rig turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.evaluation.audit.samples import Path
from ispom.geometry import Array, Pose, so3_exp, so3_log

from .fit import Fit, Problem, fitted, loss
from .intervals import LOUD, intervals, length_s, thinned

NUMBERS = ("clock_s", "mount_z", "arm_x", "arm_y", "log_unit", "log_turn_unit")
"""How late the stamps are [s]; rotation of the true mount about the odometer's vertical axis [rad]; its place, true
minus stated, along the stated axes [m]; logarithms of the measured way and rotation over the true ones."""
STEPS = np.array([5e-3, 1e-3, 0.01, 0.01, 1e-3, 1e-3])
WIDEST = np.array([2.0, 3.0, 5.0, 5.0, 10.0, 10.0])
LEAST_S, FEWEST = 0.3, 20
"""Least duration [s] of the intervals over which ways are compared, and the least number of intervals."""
MOST = 2000
LATEST_S, OFFSETS = 1.0, 41
AS_GOOD = 10.0
"""Difference of losses from which on another explanation is better: e^10 times as likely."""
HELD = 1e-6
"""Prior standard deviation of numbers that nothing measures, about the stated ones."""


@dataclass(frozen=True, eq=False)
class Rolls:
    """N intervals between images that the wheels measured wholly."""

    begins_s: Array
    """(N,)"""
    ends_s: Array
    moved: tuple[Array, Array, Array, Array]
    """Rotations (N, 3, 3) and places (N, 3) of the rig at the begin, and at the end."""
    knots_s: Array
    """(M,) of the increments."""
    sums: Array
    """(M, 1 or 2) way, and rotation about the vertical axis where a pair of wheels is measured, up to each."""
    rig_from_wheel: Pose
    """As stated."""
    noise: float = 0.0
    """Share of noise in the changes of the rates (`length_s`)."""

    @property
    def clock_shows(self) -> bool:
        """Whether the rates change by more than their noise."""
        return self.noise < LOUD

    def measured(self, late_s: float) -> Array:
        """Returns way and rotation (N, 1 or 2) in each interval, where the stamps are late. Only these are
        interpolated: between poses of images, their noise would be less, and the best clock there."""
        return np.stack(
            [
                np.interp(self.ends_s + late_s, self.knots_s, column)
                - np.interp(self.begins_s + late_s, self.knots_s, column)
                for column in self.sums.T
            ],
            axis=1,
        )

    def twists(self, values: Array) -> Array:
        """Returns (N, 6) twists of the odometer by the images, in its frame."""
        onto = self.rig_from_wheel @ Pose(so3_exp(np.array([0.0, 0.0, values[1]])), np.append(values[2:4], 0.0))
        (r0, p0), (r1, p1) = (
            (r @ onto.rotation, p + r @ onto.translation) for r, p in (self.moved[:2], self.moved[2:])
        )
        back = np.swapaxes(r0, 1, 2)
        turn = so3_log(back @ r1)
        # Half of the rotation: exact for an arc in the plane but for a share of angle^2 / 24.
        moved = np.einsum("nij,nj->ni", np.swapaxes(so3_exp(0.5 * turn), 1, 2) @ back, p1 - p0)
        return np.hstack([moved, turn])

    def residuals(self, values: Array) -> Array:
        """Returns (N, 2) [m/s] of the way and sideways, and [rad/s] of the rotation where it is measured."""
        twist, measured = self.twists(values), self.measured(values[0])
        rows = [measured[:, 0] - np.exp(values[4]) * twist[:, 0], np.exp(values[4]) * twist[:, 1]]
        if measured.shape[1] > 1:
            rows.append(measured[:, 1] - np.exp(values[5]) * twist[:, 5])
        return np.stack(rows, axis=1) / (self.ends_s - self.begins_s)[:, None]


def rolls(
    path: Path, knots_s: Array, ways: Array, turns: Array | None, rig_from_wheel: Pose, length: float | None = None
) -> Rolls | None:
    """Returns the intervals of a path within increments between knots (M,), as long as the clock needs, or of this
    length [s]; None where there are too few."""
    if path.rotations is None or len(ways) < FEWEST:
        return None
    seconds = np.diff(knots_s)[:, None]
    rates = np.stack([each for each in (ways, turns) if each is not None], axis=1) / seconds
    usual, noise = length_s(knots_s[1:], rates)
    first, last = intervals(path, max(usual, LEAST_S) if length is None else length)
    good = (path.times_s[first] >= knots_s[0]) & (path.times_s[last] <= knots_s[-1])
    first, last = thinned(first[good], last[good], MOST)
    if len(first) < FEWEST:
        return None
    sums = np.stack([np.append(0.0, np.cumsum(each)) for each in (ways, turns) if each is not None], axis=1)
    ends = path.rotations[first], path.positions[first], path.rotations[last], path.positions[last]
    return Rolls(path.times_s[first], path.times_s[last], ends, knots_s, sums, rig_from_wheel, noise)


@dataclass(frozen=True, eq=False)
class WheelFit:
    """The numbers that fit best: the clock by long intervals, the others by short ones with that clock."""

    clock: Fit
    others: Fit


def wheel_fit(long: Rolls, short: Rolls) -> WheelFit:
    """Returns the fits that are nearest to the stated numbers, of those that are equally good."""
    problem, free = _problem(long), np.ones(6, bool)
    free[0] = long.clock_shows
    fits = [fitted(problem, np.where(free, start, 0.0), free) for start in _starts(long)]
    scale = np.min([fit.scale for fit in fits], axis=0)
    losses = [loss(problem.residuals(fit.values) / scale) for fit in fits]
    good = [fit for fit, each in zip(fits, losses, strict=True) if each <= min(losses) + AS_GOOD]
    clock = min(good, key=lambda fit: abs(float(fit.values[0])) + abs(float(fit.values[1])))
    return WheelFit(clock, fitted(_problem(short), clock.values, np.arange(6) > 0))


def _problem(seen: Rolls) -> Problem:
    information = np.zeros((6, 6))
    if seen.sums.shape[1] == 1:
        information[5, 5] = HELD**-2
    return Problem(seen.residuals, STEPS, WIDEST, (np.zeros(6), information))


def _starts(seen: Rolls) -> list[Array]:
    """Returns numbers by which ways and rotations are as large: with the clock as stated, and as is best, each with the
    mount as stated and by its direction of motion."""
    tried = []
    for late in np.linspace(-LATEST_S, LATEST_S, OFFSETS):
        start = np.zeros(6)
        start[0] = late
        twist, measured = seen.twists(start), seen.measured(late)
        ahead, left = (float(np.median(twist[:, k] * np.sign(measured[:, 0]))) for k in (0, 1))
        start[1] = float(np.arctan2(left, ahead))
        start[4] = _log_ratio(measured[:, 0], np.linalg.norm(twist[:, :2], axis=1))
        start[5] = _log_ratio(measured[:, 1], twist[:, 5]) if measured.shape[1] > 1 else 0.0
        tried.append((float(np.median(abs(seen.residuals(start)), axis=0).sum()), start))
    chosen = [tried[OFFSETS // 2][1], min(tried, key=lambda each: each[0])[1]]
    return [*chosen, *(np.where(np.arange(6) == 1, 0.0, each) for each in chosen)]


def _log_ratio(measured: Array, true: Array) -> float:
    size = float(np.median(abs(true)))
    return float(np.log(max(float(np.median(abs(measured))), 1e-9) / max(size, 1e-9)))
