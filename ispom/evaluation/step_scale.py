"""How the unit of a trajectory without metric scale changes along the path (Fig. 8, line B: it shrinks)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.types import Trajectory

CHORDS = 40
WINDOWS = 10


@dataclass(frozen=True)
class StepScale:
    """Estimated over true length, as a share of that at the beginning."""

    windows: tuple[float, ...]
    """In ten windows of equal true length along the path, the first being 1."""

    first: float
    """The share itself of the first window: the estimate's units per unit of the truth."""
    middles_ns: tuple[int, ...]
    """When each window's middle chord begins."""

    @property
    def end_over_start(self) -> float:
        return self.windows[-1]


def step_scale(estimate: Trajectory, truth: Trajectory) -> StepScale | None:
    """From 40 chords of equal true path length, by the median of each window's four: noise and shake hardly count.

    Both hold associated positions of the same camera. None where the path is too short for that, or the estimate
    does not move at its beginning.
    """
    travelled = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(truth.translations, axis=0), axis=1))])
    if len(truth) <= CHORDS or travelled[-1] == 0:
        return None
    ends = np.unique(np.searchsorted(travelled, np.linspace(0, travelled[-1], CHORDS + 1)).clip(0, len(truth) - 1))
    own, true = (np.linalg.norm(np.diff(t.translations[ends], axis=0), axis=1) for t in (estimate, truth))
    ratios, starts_ns = own[true > 0] / true[true > 0], truth.times_ns[ends[:-1]][true > 0]
    if len(ratios) < WINDOWS:
        return None
    windows = np.array_split(np.arange(len(ratios)), WINDOWS)
    medians = np.array([np.median(ratios[window]) for window in windows])
    if medians[0] <= 0:
        return None
    middles_ns = tuple(int(starts_ns[window[len(window) // 2]]) for window in windows)
    return StepScale(tuple((medians / medians[0]).tolist()), float(medians[0]), middles_ns)
