"""Consistency of covariances: normalised estimation error squared (NEES; Bar-Shalom et al. 2001, section 5.4.2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ispom.geometry import Array, Pose
from ispom.types import Step, Trajectory

DOF = 6
PARTS = {"pose": slice(0, 6), "position": slice(0, 3), "orientation": slice(3, 6)}
"""Components of a twist (rho, phi)."""


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors of one run's poses, and their estimated covariances."""

    times_ns: NDArray[np.int64]
    """(K,)."""
    twists: Array
    """(K, 6) (rho [m, or own unit], phi [rad]) with true pose = estimate @ exp(twist)."""
    covariances: Array
    """(K, 6, 6) of these."""

    def nees(self, part: slice = PARTS["pose"]) -> Array:
        """Returns e' P^-1 e (K,) of the pose or a part of it; its mean is the part's size where P is right."""
        e, p = self.twists[:, part], self.covariances[:, part, part]
        return np.einsum("ki,ki->k", e, np.linalg.solve(p, e[..., None])[..., 0])


@dataclass(frozen=True)
class Consistency:
    """NEES of several independent runs, averaged over the runs at each time."""

    dof: int
    runs: int
    average: float
    """Over runs and times; `dof` where the covariance is right, more where it is too small."""
    band: tuple[float, float]
    """95 % band of the average over the runs at one time."""
    inside: float
    """Share of the times whose average lies in the band: about 0.95 where the covariance is right."""
    above: float
    """Share of the times whose average lies above: the covariance is too small."""
    below: float
    """Share of the times whose average lies below: the covariance is too large."""
    longest_above_s: float
    """Longest time that the average stays above, up to the first time that it does not."""

    @property
    def sigma_factor(self) -> float:
        """Factor by which standard deviations should be multiplied."""
        return float(np.sqrt(self.average / self.dof))


def errors(steps: Iterable[Step], truth: Trajectory, own_unit: bool = False) -> Errors:
    """Returns the errors of all steps with a pose and a covariance; `truth` is world_from_FRAME of the same frame.

    The covariances are relative to the first pose: the truth is aligned there, and that pose is not used. With
    `own_unit` the poses have no metric scale, and their covariances are also relative to the length of one baseline:
    from the first pose to the first one with a covariance, where the map began. The truth is scaled so that this one
    length agrees (no fit to the rest), and that pose is not used either; twists are then in that unit.
    """
    times, twists, covariances = [], [], []
    first: tuple[Pose, Pose] | None = None
    unit = None if own_unit else 1.0
    for step in steps:
        pose, true = step.world_from_frame, truth.at(step.time_ns)
        if pose is None or true is None:
            continue
        if first is None:
            first = pose, true
            continue
        if step.covariance is None:
            continue
        moved = first[1].inverse() @ true
        if unit is None:
            length = np.linalg.norm(pose.translation - first[0].translation)
            unit = float(length / np.linalg.norm(moved.translation))
            continue
        times.append(step.time_ns)
        twists.append((pose.inverse() @ first[0] @ moved.scaled(unit)).log())
        covariances.append(step.covariance)
    k = len(times)
    return Errors(np.array(times, np.int64), np.reshape(twists, (k, DOF)), np.reshape(covariances, (k, DOF, DOF)))


def consistency(runs: list[Errors], part: slice = PARTS["pose"]) -> Consistency | None:
    """Averages over the times that all runs share; None where there are none."""
    if not runs:
        return None
    common = sorted(set.intersection(*(set(run.times_ns.tolist()) for run in runs)))
    if not common:
        return None
    rows = np.stack([run.nees(part)[np.isin(run.times_ns, common)] for run in runs])
    dof, count = part.stop - part.start, len(runs)
    low, high = band(dof, count)
    mean = rows.mean(axis=0)
    above, below = mean > high, mean < low
    return Consistency(
        dof=dof,
        runs=count,
        average=float(rows.mean()),
        band=(low, high),
        inside=float((~above & ~below).mean()),
        above=float(above.mean()),
        below=float(below.mean()),
        longest_above_s=_longest_s(np.array(common), above),
    )


def _longest_s(times_ns: NDArray[np.int64], holds: NDArray[np.bool_]) -> float:
    """Returns the longest stretch of times (K,) at which `holds`, up to the next time at which it does not."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]])))
    begins, ends = edges[::2], np.minimum(edges[1::2], len(holds) - 1)
    return float((times_ns[ends] - times_ns[begins]).max(initial=0)) * 1e-9


def band(dof: int, runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Returns the bounds of the average NEES of `runs` independent runs at this probability (chi-square)."""
    tails = np.array([(1 + probability) / 2, (1 - probability) / 2])
    low, high = chdtri(dof * runs, tails) / runs
    return float(low), float(high)
