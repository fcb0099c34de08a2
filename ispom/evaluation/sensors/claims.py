"""Claims about a sensor: a number with its standard deviation, and whether it is wrong, right, or unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

from .fit import Fit, HeldOut, fitted, held_out, loss

SURE = 4.0
"""Standard deviations by which a number must differ from the stated one to be wrong: they come from ten groups, and
several numbers of each recording are tested."""
SUSPICIOUS = 2.5
"""Standard deviations of the difference from which on the verdict is "cannot tell"."""
LEAST_GAIN = 0.02
"""Share of the loss of held-out groups that a wrong number must explain."""
LEAST_NATS = 6.0
"""Least decrease of that loss: e^6 times as likely, as 3.5 standard deviations are."""
LEAST_BETTER = 0.6
"""Share of these groups that must not become worse."""


CERTAIN = HeldOut(1.0, np.inf, 1.0)
"""The result for claims that need no test."""


@dataclass(frozen=True)
class Claim:
    """A claim about one number, or one group of numbers, of a sensor."""

    key: str
    """Such as imu-clock."""
    sensor: str
    """In the rig."""
    size: float
    """Difference from the stated value."""
    sigma: float
    least: float
    """Size from which on it matters."""
    sentence: str
    unit: tuple[float, str] = (1.0, "")
    """Factor by which sizes are multiplied for people, and the unit then."""
    values: Mapping[str, float] = field(default_factory=dict)
    held_out: HeldOut = CERTAIN
    """Result for groups that had no part in the fit."""
    rival: str = ""
    """Another cause that would explain the same; empty without one."""

    @property
    def large(self) -> bool:
        return self.size >= self.least

    @property
    def explains(self) -> bool:
        found = self.held_out
        return found.gain >= LEAST_GAIN and found.nats >= LEAST_NATS and found.better >= LEAST_BETTER

    @property
    def found(self) -> bool:
        return self.large and self.size >= SURE * self.sigma and self.explains and not self.rival

    @property
    def undecided(self) -> bool:
        return not self.found and self.large and self.size >= SUSPICIOUS * self.sigma

    @property
    def shows_from(self) -> float:
        """The least size that this recording would show."""
        return max(self.least, SURE * self.sigma)

    @property
    def evidence(self) -> str:
        """Returns sentences about the result, and about the least size that would be found."""
        if self.found:
            share = self.held_out.gain
            held = f" Stretches that had no part in the fit are explained better by {share:.0%}." if share < 1 else ""
            return f"{self.sentence}.{held}"
        factor, word = self.unit
        least = f" It would show from {factor * self.shows_from:.2g} {word}".rstrip() if word else ""
        return f"{self.sentence}.{least}{'.' if least else ''}"

    @property
    def strength(self) -> float:
        """Returns the strength of the claim; from 1 on it is found."""
        strength = (
            min(self.size / self.least, self.size / (SURE * self.sigma)) if self.sigma > 0 else self.size / self.least
        )
        return strength if self.found else min(strength, 0.9)


def tested(fit: Fit, numbers: list[int], claim: Claim) -> Claim:
    """Returns the claim with a test of these numbers on held-out groups, against a fit with the stated numbers. A claim
    that is too small to need a test is not tested."""
    if not claim.large or claim.size < SUSPICIOUS * claim.sigma:
        return claim
    free: NDArray[np.bool_] = fit.free.copy()
    free[numbers] = False
    start = fit.values.copy()
    start[numbers] = 0.0
    null = fitted(fit.problem, start, free)
    sigma = max(claim.sigma, claim.size / max(_likelier(fit, null), 1e-6))
    return replace(claim, sigma=sigma, held_out=held_out(fit, null))


def _likelier(fit: Fit, null: Fit) -> float:
    """Returns by how many standard deviations the numbers are from what is stated, by the loss of both fits: the
    normal equations say more where another valley is as deep."""
    costs = [loss(fit.problem.residuals(v) / fit.scale) + fit.problem.prior(v)[2] for v in (null.values, fit.values)]
    return float(np.sqrt(2 * max(costs[0] - costs[1], 0.0)))


def along(vector: Array, covariance: Array) -> tuple[float, float]:
    """Returns the length of a vector (K,) and the standard deviation along it."""
    size = float(np.linalg.norm(vector))
    if size == 0:
        return 0.0, float(np.sqrt(np.diag(covariance).max(initial=0.0)))
    way = vector / size
    return size, float(np.sqrt(max(way @ covariance @ way, 0.0)))
