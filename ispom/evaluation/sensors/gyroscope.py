"""Compares the gyroscope with the rotations of the images: its clock, mount, unit and bias at once.

The rotation from one image to the next is the integral of the gyroscope's rates, about other axes. A wrong clock shows
where the rate of turning changes, a wrong mount where the rig turns about another axis than that of the mount's error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.signal import lfilter

from ispom.evaluation.audit.samples import Path
from ispom.geometry import Array, so3_exp, so3_log
from ispom.sensors.imu import LONGEST_GAP_S

from .fit import Fit, Problem, fitted, loss
from .intervals import LENGTHS_S, LOUD, intervals, length_s, thinned

NUMBERS = ("clock_s", "mount_x", "mount_y", "mount_z", "log_unit", "bias_x", "bias_y", "bias_z")
"""How late the stamps are [s]; rotation vector by which the true mount is turned, along the rig's axes [rad]; logarithm
of the measured rate over the true one; bias along the unit's axes, of the true rate [rad/s]."""
STEPS = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4])
WIDEST = np.array([1.0, 3.0, 3.0, 3.0, 5.0, 0.5, 0.5, 0.5])
"""Prior standard deviations, how wrong each number can be at all. Whole seconds of the clock are another start of the
recording, which is found by other means; the mount can have any direction; any unit; a bias of 30 deg/s."""
FEWEST = 20
"""Fewer intervals say nothing."""
MOST = 600
"""Intervals that are compared; of more, every second, third, ... is."""
SUBSTEP_S = 0.02
"""Longest time in which rates count as constant: coning motions of a hand are exact to 1e-5 rad then."""
MOST_SUBSTEPS = 40
"""Long intervals are those of slow motions."""
LATEST_S, OFFSETS = 1.0, 201
"""Largest clock offset from which a fit starts [s], and the number of offsets that are tried."""
AS_GOOD = 1.05
"""Largest ratio of losses with which a fit nearer to the stated numbers is preferred: numbers that the motion does not
determine stay as stated, and a motion that repeats itself fits at each period."""
AS_GOOD_CHANCE = 10.0
"""Difference of losses that chance makes: half a chi-square of eight numbers, nineteen times of twenty, and more."""
CHANCE = 3.0
"""Correlation of two noises by chance, in standard deviations."""
HIDDEN = 1e-3
"""An axis is hidden where the rig turns about all others by less than this share of its turns (mean squares)."""
MOST_ALIKE = 0.47
"""Two neighbouring residuals of poses that err each by itself have a correlation of -0.5; a little less keeps sums
finite."""
HELD_RAD, HELD_S = 1e-4, 1e-5
"""Prior standard deviations of numbers that the motion does not determine, about the stated ones."""
UNITS = {1.0: "rad/s", 180 / np.pi: "degrees per second", np.pi / 180: "radians that were taken for degrees"}


@dataclass(frozen=True, eq=False)
class Turns:
    """N intervals between images that the gyroscope measured wholly."""

    begins_s: Array
    """(N,)"""
    ends_s: Array
    turned: Array
    """(N, 3) rotation vectors of the rig by the images [rad], from its frame at the begin."""
    times_s: Array
    """(M,) of the samples."""
    angle: Array
    """(M, 3) integral of the measured rates."""
    rig_from_imu: Array
    """(3, 3) as stated."""
    noise: float = 0.0
    """Share of noise in the changes of the rate (`length_s`)."""
    apart: bool = True
    """Whether no interval overlaps the next one."""
    carry: float = 0.0
    """Part of a residual that the next one has with the other sign."""

    def sums(self, late_s: float, count: int = 1) -> Array:
        """Returns the integral of the rates over each of `count` equal parts of the intervals (N, count, 3), where the
        stamps are late."""
        share = np.linspace(0, 1, count + 1)
        knots = self.begins_s[:, None] * (1 - share) + self.ends_s[:, None] * share + late_s
        return np.diff(np.stack([np.interp(knots, self.times_s, column) for column in self.angle.T], axis=2), axis=1)

    def predicted(self, values: Array) -> Array:
        """Returns the rotation vectors (N, 3) of the rig by the gyroscope."""
        seconds = self.ends_s - self.begins_s
        count = min(MOST_SUBSTEPS, max(1, round(float(np.median(seconds)) / SUBSTEP_S)))
        parts = np.exp(-values[4]) * self.sums(values[0], count) - values[5:8] * (seconds / count)[:, None, None]
        turn = np.broadcast_to(np.eye(3), (len(seconds), 3, 3))
        for k in range(count):
            turn = turn @ so3_exp(parts[:, k])
        return so3_log(turn) @ (so3_exp(values[1:4]) @ self.rig_from_imu).T

    def residuals(self, values: Array) -> Array:
        """Returns (N, 3) [rad/s], of independent noise."""
        raw = (self.predicted(values) - self.turned) / (self.ends_s - self.begins_s)[:, None]
        return np.asarray(lfilter([1.0], [1.0, -self.carry], raw, axis=0))

    @property
    def clock_shows(self) -> bool:
        """Whether the rate changes by more than its noise."""
        return self.noise < LOUD

    @property
    def mean_rates(self) -> Array:
        """(N, 3) of the images [rad/s]."""
        return self.turned / (self.ends_s - self.begins_s)[:, None]


def turns(path: Path, times_s: Array, rates: Array, rig_from_imu: Array) -> Turns | None:
    """Returns the intervals of a path with rotations; None where there are too few."""
    length, noise = length_s(times_s, rates)
    first, last = intervals(path, length)
    gaps = np.append(0, np.cumsum(np.diff(times_s) > LONGEST_GAP_S))
    whole = [np.interp(path.times_s[i], times_s, gaps, left=-1, right=-1) for i in (first, last)]
    good = (whole[0] == whole[1]) & (whole[0] == np.rint(whole[0])) & (whole[0] >= 0)
    first, last = thinned(first[good], last[good], MOST)
    if len(first) < FEWEST or path.rotations is None:
        return None
    turned = so3_log(np.swapaxes(path.rotations[first], 1, 2) @ path.rotations[last])
    steps = np.diff(times_s)[:, None] * (rates[1:] + rates[:-1]) / 2
    angle = np.vstack([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    apart = length <= LENGTHS_S[0]
    return Turns(path.times_s[first], path.times_s[last], turned, times_s, angle, rig_from_imu, noise, apart)


@dataclass(frozen=True, eq=False)
class GyroscopeFit:
    """The numbers (`NUMBERS`) that fit best; of equally good ones, those nearest to the stated ones."""

    turns: Turns
    fit: Fit
    hidden: Array
    """(K, 3) unit vectors in the rig about which a turned mount does not show, as the rig turns about no other axis."""


def gyroscope_fit(seen: Turns) -> GyroscopeFit:
    """Returns the fit. A first fit gives the noise, and the numbers that the motion does not determine."""
    first = _nearest(seen, np.zeros((0, 3)))
    late, hidden = float(first.values[0]), hidden_axes(seen, first)
    seen = replace(seen, carry=_carry(first.residuals) if seen.apart else 0.0)
    return GyroscopeFit(seen, _nearest(seen, hidden, late), hidden)


def _nearest(seen: Turns, hidden: Array, late_s: float | None = None) -> Fit:
    """Returns the fit that is nearest to the stated numbers, of those that are equally good."""
    information = np.zeros((8, 8))
    information[1:4, 1:4] = hidden.T @ hidden / HELD_RAD**2
    if not seen.clock_shows:
        information[0, 0] = HELD_S**-2
    problem = Problem(seen.residuals, STEPS, WIDEST, (np.zeros(8), information))
    fits = [fitted(problem, start) for start in _starts(seen, late_s)]
    scale = min(fits, key=lambda fit: float(np.prod(fit.scale))).scale
    losses = [loss(problem.residuals(fit.values) / scale) for fit in fits]
    good = [fit for fit, each in zip(fits, losses, strict=True) if each <= AS_GOOD * min(losses) + AS_GOOD_CHANCE]
    return min(good, key=lambda fit: _far(fit.values))


def hidden_axes(seen: Turns, fit: Fit) -> Array:
    """Returns the axes (K, 3) of GyroscopeFit. Only the common part of both measurements counts, because the noises of
    images and gyroscope are independent."""
    seconds = (seen.ends_s - seen.begins_s)[:, None]
    mine, theirs = (
        _clipped(each - each.mean(axis=0)) for each in (seen.mean_rates, seen.predicted(fit.values) / seconds)
    )
    axes, sizes, _ = np.linalg.svd(mine.T @ theirs / len(mine))
    # Two noises, of which the sum is known, have a product as large as this by chance.
    chance = CHANCE * float(fit.scale.max()) ** 2 / 2 / np.sqrt(len(mine))
    left = np.maximum(sizes - chance, 0.0)
    return np.array([axes[:, k] for k in range(3) if left.sum() - left[k] <= HIDDEN * sizes[0]]).reshape(-1, 3)


def _carry(residuals: Array) -> float:
    """Returns the part of a residual that the next one has with the other sign: that of images whose poses err each by
    itself, rather than their motions."""
    clipped = np.clip(residuals, -3, 3)
    alike = float((clipped[1:] * clipped[:-1]).sum() / max(float((clipped**2).sum()), 1e-300))
    alike = min(max(alike, -MOST_ALIKE), 0.0)
    return 0.0 if alike == 0 else (1 - np.sqrt(1 - 4 * alike**2)) / (2 * -alike)


def _far(values: Array) -> float:
    """Returns the distance of numbers from the stated ones; a quarter turn counts as a second."""
    return float(abs(values[0]) + np.linalg.norm(values[1:4]) / (np.pi / 2) + abs(values[4]))


def _starts(seen: Turns, late_s: float | None) -> list[Array]:
    """Returns the numbers (8,) from which fits start: as stated, the best clock for the stated mount, and the best of
    clock and mount by axes. A clock that is known already takes the place of the best ones."""
    offsets = np.linspace(-LATEST_S, LATEST_S, OFFSETS) if late_s is None else np.array([0.0, late_s])
    found = [_aligned(seen, float(offset)) for offset in offsets]
    zero = int(np.argmin(abs(offsets)))
    best, free = (int(np.argmax(values)) for values in ([each[0] for each in found], [each[1] for each in found]))
    made = []
    for i, with_mount in ((zero, False), (best, False), (zero, True), (free, True)):
        start = np.zeros(8)
        start[0], start[4] = offsets[i], _log_unit(found[i][3])
        start[1:4] = so3_log(found[i][2]) if with_mount else 0.0
        if not any(np.allclose(start, other) for other in made):
            made.append(start)
    return made


def _aligned(seen: Turns, late_s: float) -> tuple[float, float, Array, float]:
    """Returns the correlation of rates with the stated mount, and with the best one by axes, that mount (3, 3), and the
    ratio of the sizes of the rates."""
    seconds, mine = (seen.ends_s - seen.begins_s)[:, None], seen.mean_rates
    theirs = seen.sums(late_s)[:, 0] / seconds @ seen.rig_from_imu.T
    across = _clipped(theirs - theirs.mean(axis=0)).T @ _clipped(mine - mine.mean(axis=0)) / len(mine)
    sizes = [max(float(np.linalg.norm(each.std(axis=0))), 1e-12) for each in (theirs, mine)]
    turn = _nearest_axes(across)
    stated, free = (float(np.trace(r @ across)) / (sizes[0] * sizes[1]) for r in (np.eye(3), turn))
    return stated, free, turn, sizes[0] / sizes[1]


def _clipped(values: Array) -> Array:
    """Single wrong rotations do not decide."""
    most = 3 * np.maximum(np.percentile(abs(values), 90, axis=0), 1e-12)
    return np.clip(values, -most, most)


def _log_unit(ratio: float) -> float:
    """Returns the logarithm of the unit that a ratio of sizes is nearest to; 0 below twice."""
    near = min(UNITS, key=lambda unit: abs(np.log(ratio / unit)))
    return float(np.log(near if abs(np.log(ratio / near)) < np.log(2) else ratio))


def _nearest_axes(across: Array) -> Array:
    """Returns the rotation (3, 3) of axes onto axes that fits sums of products best; of several, the smallest one."""
    best, most = np.eye(3), float(np.trace(across))
    for each in AXES:
        value = float(np.trace(each @ across))
        if value > most * (1 + 1e-3) + 1e-15:
            best, most = each, value
    return best


def _axes() -> list[Array]:
    """Returns the 24 rotations of axes onto axes, smallest first."""
    found = []
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.eye(3)[list(order)] * np.array(signs)[:, None]
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return sorted(found, key=lambda turn: -np.trace(turn))


AXES = _axes()
