"""The arithmetic of an error budget: shares of the squared error, their intervals, and what they leave unexplained.

Squared errors are compared, as the variances of independent causes add; where causes act on each other, that is part of
the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from scipy.stats import t as student

from ispom.evaluation.trajectory_error import TrajectoryError

LEVEL = 0.9
"""Probability with which the true share is to lie in its interval."""
LEAST_COMMON = 0.5
"""A rerun is compared where it has a pose at this share of the poses of the run, at least: of fewer, the error is that
of another path."""
VAGUE = "repetitions differ by more than the whole error"
"""Why there is no share where there was one."""


@dataclass(frozen=True)
class Share:
    """A part of the squared error [m^2]; negative where the cause makes up for others."""

    value_m2: float
    low_m2: float
    high_m2: float
    """The limits of its interval, which holds with the probability LEVEL."""

    @staticmethod
    def around(value_m2: float, half_m2: float) -> Share:
        """Returns the share with an interval of this half width."""
        return Share(value_m2, value_m2 - half_m2, value_m2 + half_m2)

    @property
    def half_m2(self) -> float:
        """Half the width of the interval."""
        return (self.high_m2 - self.low_m2) / 2

    def contains(self, value_m2: float) -> bool:
        """Checks whether the interval contains a value."""
        return self.low_m2 <= value_m2 <= self.high_m2


@dataclass(frozen=True)
class Cause:
    """One row of the budget."""

    name: str
    removed: str
    """How it was removed, in words."""
    share: Share | None = None
    """None where it could not be tested."""
    unknown: str = ""
    """Why it could not be tested; empty where it was."""

    def told(self, ate_m: float) -> Cause:
        """Returns it without a share that is known no better than by the whole squared error: such an interval contains
        whatever is true."""
        if self.share is None or self.share.half_m2 <= ate_m**2:
            return self
        return Cause(self.name, self.removed, unknown=VAGUE)


@dataclass(frozen=True)
class Budget:
    """The error of one method, split by causes."""

    method: str
    alignment: str
    ate_m: float
    poses: int
    causes: tuple[Cause, ...]

    @property
    def rest(self) -> Share:
        """Returns the share of the squared error that no cause explains; negative where causes overlap."""
        known = [cause.share for cause in self.causes if cause.share is not None]
        value = self.ate_m**2 - sum(share.value_m2 for share in known)
        return Share.around(value, hypot(0.0, *(share.half_m2 for share in known)))


def factor(count: int) -> float:
    """Returns the half width of an interval over a standard deviation that `count` independent values gave."""
    return float(student.ppf((1 + LEVEL) / 2, count))


def share_of(fall_m2: float, repeated_m2: Sequence[float]) -> Share | None:
    """Returns the share of a cause whose removal lowers the squared error by `fall_m2`. In repetitions with other
    noise, and with other draws of the removed parts, it lowers the error by `repeated_m2`. None without repetitions.

    The repetitions scatter about the first one, which is known; so each counts fully.
    """
    if not repeated_m2:
        return None
    spread = sqrt(float(np.mean((np.asarray(repeated_m2) - fall_m2) ** 2)))
    return Share.around(fall_m2, factor(len(repeated_m2)) * spread)


def mean_share(falls_m2: Sequence[float]) -> Share | None:
    """Returns the share of a cause that can be removed in several ways, none better than another, at least two. None
    of fewer."""
    count = len(falls_m2)
    if count < 2:
        return None
    spread = float(np.std(falls_m2, ddof=1)) * sqrt(1 + 1 / count)
    return Share.around(float(np.mean(falls_m2)), factor(count - 1) * spread)


def common(before: TrajectoryError, after: TrajectoryError) -> tuple[TrajectoryError, TrajectoryError] | None:
    """Returns both errors over the poses that both have, aligned again; None where these are too few of `before`."""
    times_ns = np.intersect1d(before.estimate.times_ns, after.estimate.times_ns)
    if len(times_ns) < LEAST_COMMON * len(before.estimate):
        return None
    one, two = before.over(times_ns), after.over(times_ns)
    return None if one is None or two is None else (one, two)


def fall_m2(before: TrajectoryError, after: TrajectoryError) -> float | None:
    """Returns by how much the squared error falls over the poses that both have [m^2]; None where these are too few."""
    both = common(before, after)
    return None if both is None else both[0].ate_m ** 2 - both[1].ate_m ** 2


def noise_share(run: TrajectoryError, noisier: Sequence[TrajectoryError]) -> Share | None:
    """Returns the share of the noise, from runs with as much noise again on the images as they have. None without any.

    Noise n_k moves the aligned path of run k by as much as the noise in the run, n, has moved that, in another
    direction. The squared error without n is smaller by |n|^2 + 2 e n, where e is the error that other causes make: its
    mean is |n|^2, and its scatter that of both terms.
    """
    sizes, crossed = list[float](), list[float]()
    for each in noisier:
        if (both := common(run, each)) is None:
            continue
        moved = both[1].aligned.translations - both[0].aligned.translations
        error = both[0].aligned.translations - both[0].reference.translations
        sizes.append(float((moved**2).sum(axis=1).mean()))
        crossed.append(float(2 * (error * moved).sum(axis=1).mean()))
    if not sizes:
        return None
    spread = sqrt(float(np.mean(np.square(crossed)) + np.var(sizes)))
    return Share.around(float(np.mean(sizes)), factor(len(sizes)) * spread)
