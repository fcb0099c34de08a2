"""One change of the calibration or clock: what held-out tracks say of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array
from ispom.types import Rig

from .adjustment import Promise, adjust, adjust_gradually, placed, screened
from .hypothesis import Change
from .scene import Observations, Scene, predicted
from .start import Start

ROUGH_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class Baseline:
    """The scene with the calibration as it is stated."""

    rig: Rig
    first: Scene
    """As the main camera alone saw it: no calibration of the others has a part in it."""
    scene: Scene
    used: Observations
    """Of the tracks that poses and calibration are fitted to."""
    held_out: Observations
    costs: Array
    """(P,) mean cost of each held-out point; NaN for the others."""
    residual_px: float
    """Median error of the held-out observations."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a change of the calibration does."""

    change: Change
    gain: float
    """Share of the cost of the held-out tracks that it explains; negative where it makes them worse."""
    z: float
    """Mean improvement of a held-out track over its standard error."""
    residual_px: float
    """Median error of the held-out observations with the change."""
    tracks: int
    """Held-out tracks."""


def baseline(start: Start, rig: Rig) -> Baseline:
    """Fits the scene to the tracks that are not held out, and judges it by those that are."""
    out = start.held_out[start.seen.point]
    used, held_out = start.seen.select(~out), start.seen.select(out)
    scene, change, _ = min(
        (adjust(start.scene, rig, used, (), ROUGH_ITERATIONS), adjust_gradually(start.scene, rig, used)),
        key=lambda fitted: fitted[2],
    )
    scene, _ = placed(scene, rig, change, held_out)
    scene, costs = placed(
        scene, rig, change, held_out
    )  # so that a change is not credited with what was left to do here
    return Baseline(rig, start.scene, scene, used, held_out, costs, _median(scene, rig, change, held_out))


def promising(base: Baseline, subsets: tuple[tuple[str, ...], ...]) -> dict[tuple[str, ...], Promise]:
    """Returns what a linearisation at the baseline promises for each set of numbers: a rough gain, in a tenth of the
    time of a test, and how well the observations know the numbers."""
    return dict(zip(subsets, screened(base.scene, base.rig, base.used, subsets), strict=True))


def tested(base: Baseline, names: tuple[str, ...]) -> Outcome:
    """Returns what becomes of the held-out tracks when these numbers of the calibration are free."""
    scene, change, _ = adjust_gradually(base.first, base.rig, base.used, names)
    scene, after = placed(scene, base.rig, change, base.held_out)
    return _outcome(base, change, base.costs, after, _median(scene, base.rig, change, base.held_out))


def _outcome(base: Baseline, change: Change, before: Array, after: Array, residual_px: float) -> Outcome:
    count = np.bincount(base.held_out.point, minlength=len(base.scene.points))
    valid = np.isfinite(before) & np.isfinite(after)
    better = (before - after)[valid]
    weights = count[valid] / count[valid].sum()
    mean = float((weights * better).sum())
    total = float((weights * before[valid]).sum())
    error = float(np.sqrt((weights**2 * (better - mean) ** 2).sum()))
    return Outcome(change, mean / max(total, 1e-12), mean / max(error, 1e-12), residual_px, int(valid.sum()))


def _median(scene: Scene, rig: Rig, change: Change, seen: Observations) -> float:
    residuals = predicted(scene, rig, change, seen, derivatives=False).residuals
    return float(np.nanmedian(np.linalg.norm(residuals, axis=1)))
