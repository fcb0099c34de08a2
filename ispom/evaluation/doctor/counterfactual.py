"""Tests one change of the calibration or clock by the fit of held-out tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Rig

from .adjustment import Promise, adjust, adjust_gradually, placed, screened, uncertainties
from .hypothesis import Change
from .scene import Observations, Scene, predicted
from .start import Start

ROUGH_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Baseline:
    """The scene with the calibration as it is stated."""

    rig: Rig
    first: Scene
    """The scene from the main camera alone, without the calibration of the others."""
    scene: Scene
    used: Observations
    """Observations of the tracks to which poses and calibration are fitted."""
    held_out: Observations
    costs: Array
    """(P,) mean cost of each held-out point; NaN for the others."""
    residual_px: float
    """Median error of the held-out observations."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The effect of a change of the calibration."""

    change: Change
    costs: Array
    """(P,) mean cost of each held-out point with the change; NaN for the others."""
    gain: float
    """Share of the cost of the held-out tracks that it explains; negative if it increases the cost."""
    z: float
    """Mean improvement of a held-out track over its standard error."""
    residual_px: float
    """Median error of the held-out observations with the change."""
    tracks: int
    """Held-out tracks."""


@dataclass(frozen=True)
class Figure:
    """A number of the calibration, estimated from the tracks."""

    value: float
    sigma: float
    """Standard deviation."""


@dataclass(frozen=True, eq=False)
class Crossed:
    """The effect of a change if each half of the tracks judges the change that was fitted to the other half."""

    figures: Mapping[str, Figure]
    """By the number's name: the mean of the halves. Its uncertainty is that of the normal equations and the difference
    of the halves."""
    gain: float
    z: float
    """Mean improvement of a track over its standard error."""
    majority: float
    """Number of tracks that fit better minus those that fit worse, over its standard error. A few bad tracks, such as
    in a corner of the image, can dominate a mean, but not this."""
    before_px: float
    residual_px: float
    tracks: int
    costs: Array
    """(2 P,) mean cost of each point with the change, of one half and then the other; NaN where it is not held out."""
    fitted: tuple[tuple[Scene, Change], ...]
    """The scene and the change that were fitted to each half."""

    def better_than(self, other: Crossed) -> float:
        """Returns how much better the tracks fit than with another change: the mean over its standard error."""
        difference = (other.costs - self.costs)[np.isfinite(self.costs) & np.isfinite(other.costs)]
        error = float(difference.std()) / np.sqrt(max(len(difference), 1))
        return float(difference.mean()) / max(error, 1e-12) if len(difference) else 0.0


def baseline(start: Start, rig: Rig, held_out: NDArray[np.bool_] | None = None) -> Baseline:
    """Fits the scene to the tracks that are not held out, and judges it by the held-out ones: those of the start, or
    `held_out` (P,)."""
    out = (start.held_out if held_out is None else held_out)[start.seen.point]
    used, judging = start.seen.select(~out), start.seen.select(out)
    scene, change, _ = min(
        (adjust(start.scene, rig, used, (), ROUGH_ITERATIONS), adjust_gradually(start.scene, rig, used)),
        key=lambda fitted: fitted[2],
    )
    scene, _ = placed(scene, rig, change, judging)
    # Twice, so that a change gets no credit for convergence that was missing here.
    scene, costs = placed(scene, rig, change, judging)
    return Baseline(rig, start.scene, scene, used, judging, costs, _median(scene, rig, change, judging))


def promising(base: Baseline, subsets: Mapping[tuple[str, ...], tuple[str, ...]]) -> dict[tuple[str, ...], Promise]:
    """Returns the prediction of a linearisation at the baseline for each set of numbers: a rough gain, in a tenth of
    the time of a test, and the standard deviations of the numbers if all of a group are free."""
    return screened(base.scene, base.rig, base.used, subsets)


def tested(base: Baseline, names: tuple[str, ...]) -> Outcome:
    """Returns how the held-out tracks fit when these numbers of the calibration are free."""
    return _judged(base, *_freed(base, names))


def _freed(base: Baseline, names: tuple[str, ...]) -> tuple[Scene, Change]:
    scene, change, _ = adjust_gradually(base.first, base.rig, base.used, names)
    return scene, change


def _judged(base: Baseline, scene: Scene, change: Change) -> Outcome:
    scene, after = placed(scene, base.rig, change, base.held_out)
    gain, z, _, tracks = _gain((base,), (after,))
    return Outcome(change, after, gain, z, _median(scene, base.rig, change, base.held_out), tracks)


def crossed(halves: tuple[Baseline, ...], names: tuple[str, ...]) -> Crossed:
    """Frees these numbers in each half, and judges them in the other."""
    fitted = [_freed(base, names) for base in halves]
    outcomes = [_judged(base, *fit) for base, fit in zip(halves, fitted, strict=True)]
    costs = tuple(outcome.costs for outcome in outcomes)
    gain, z, majority, tracks = _gain(halves, costs)
    before_px = float(np.mean([base.residual_px for base in halves]))
    after_px = float(np.mean([outcome.residual_px for outcome in outcomes]))
    return Crossed(
        _figures(halves, names, fitted), gain, z, majority, before_px, after_px, tracks, np.concatenate(costs),
        tuple(fitted),
    )  # fmt: skip


def figures_of(halves: tuple[Baseline, ...], names: tuple[str, ...], fewer: Crossed) -> dict[str, Figure]:
    """Returns these numbers where all of them are free, without a judgement. Each half starts from its fit of `fewer`
    of them, too, and the better end counts: more numbers explain no less."""
    fitted = []
    for base, (scene, change) in zip(halves, fewer.fitted, strict=True):
        ends = (
            adjust(scene, base.rig, base.used, names, ROUGH_ITERATIONS, change),
            adjust_gradually(base.first, base.rig, base.used, names),
        )
        fitted.append(min(ends, key=lambda end: end[2])[:2])
    return _figures(halves, names, fitted)


def _figures(
    halves: tuple[Baseline, ...], names: tuple[str, ...], fitted: list[tuple[Scene, Change]]
) -> dict[str, Figure]:
    values = np.array([[change.value(name) for name in names] for _, change in fitted])
    sigmas = np.array([
        uncertainties(scene, base.rig, base.used, names, change)
        for base, (scene, change) in zip(halves, fitted, strict=True)
    ])  # fmt: skip
    count = len(halves)
    by_equations = np.sqrt((sigmas**2).sum(axis=0)) / count
    by_halves = values.std(axis=0, ddof=1) / np.sqrt(count)
    return {
        name: Figure(float(value), float(sigma))
        for name, value, sigma in zip(names, values.mean(axis=0), np.maximum(by_equations, by_halves), strict=True)
    }


def _gain(halves: tuple[Baseline, ...], costs: tuple[Array, ...]) -> tuple[float, float, float, int]:
    """Returns the share of the held-out cost that is saved, the mean of the savings over its standard error, the number
    of tracks that are better minus those that are worse over its standard error, and the number of tracks."""
    before = np.concatenate([base.costs for base in halves])
    after = np.concatenate(costs)
    count = np.concatenate([np.bincount(base.held_out.point, minlength=len(base.costs)) for base in halves])
    valid = np.isfinite(before) & np.isfinite(after)
    better, weights = (before - after)[valid], count[valid] / count[valid].sum()
    mean, total = float((weights * better).sum()), float((weights * before[valid]).sum())
    error = float(np.sqrt((weights**2 * (better - mean) ** 2).sum()))
    majority = float(np.sign(better).sum() / np.sqrt(max(len(better), 1)))
    return mean / max(total, 1e-12), mean / max(error, 1e-12), majority, int(valid.sum())


def _median(scene: Scene, rig: Rig, change: Change, seen: Observations) -> float:
    residuals = predicted(scene, rig, change, seen, derivatives=False).residuals
    return float(np.nanmedian(np.linalg.norm(residuals, axis=1)))
