"""Checks whether only the unit differs, where the alignment takes no scale away."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.blocks import Errors, errors, groups_of, levels
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.explanation import SIGNIFICANT, Explanation, Scene, held_out, jackknife_sigma
from ispom.evaluation.audit.samples import Samples
from ispom.geometry import Array

MIN_CHANGE = 0.05
"""Least difference of a scale from 1 that counts as another unit. A smaller one is an error of the method or of its
baseline, which the errors must show."""
NOTHING = 0.5
"""Least error of positions, relative to a block's extent, of paths that have nothing in common."""
UNITS: Mapping[str, float] = MappingProxyType(
    {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "feet": 0.3048, "kilometres": 1e3}
)
"""Metres per unit."""
UNIT_MATCH = 0.05
"""Largest relative difference from a unit that is called by its name."""


def unit(scene: Scene, before: Samples) -> Iterator[Explanation]:
    if scene.with_scale:
        return
    gains, after, scales, sigmas = [], [], [], []
    for starts in levels(len(before)):
        group = groups_of(len(starts))
        ratios = _ratios(before, starts)
        fits = np.array([[np.median(ratios[group != g])] for g in np.unique(group)])

        def at(scale: Array, starts: NDArray[np.intp] = starts) -> Errors:
            return errors(before.moved(before.own * scale[0], before.own_rotations), starts, False)

        left = held_out(at, np.exp(fits), group)
        gains.append(errors(before, starts, False).gain(left))
        after.append(left)
        scales.append(float(np.exp(np.median(ratios))))
        sigmas.append(float(jackknife_sigma(fits)[0]))
    best = int(np.argmax([gain.mean() for gain in gains]))
    change = abs(np.log(scales[best]))
    # An estimate that has nothing of the motion fits best once it is shrunk to a point.
    follows = float(np.exp(np.log(after[best].position).mean())) < NOTHING
    yield Explanation(
        "scale",
        Correction(with_scale=True),
        tuple(gains),
        tuple(after),
        1,
        {"scale": scales[best]},
        {"scale": scales[best] * sigmas[best]},
        follows and bool(np.isfinite(change) and change >= max(np.log1p(MIN_CHANGE), SIGNIFICANT * sigmas[best])),
    )


def unit_name(scale: float) -> str:
    """Returns the unit of an estimate whose scale to metres is this; "" for none that is known."""
    for name, metres in UNITS.items():
        if abs(scale / metres - 1) <= UNIT_MATCH:
            return name
    return ""


def _ratios(samples: Samples, starts: NDArray[np.intp]) -> Array:
    """Returns logarithms (B,) of the reference's extent over the estimate's, in each block."""
    counts = np.diff(np.append(starts, len(samples)))
    of_block = np.repeat(np.arange(len(starts)), counts)
    spreads = []
    for positions in (samples.own, samples.true):
        means = np.add.reduceat(positions, starts) / counts[:, None]
        spreads.append(np.add.reduceat(((positions - means[of_block]) ** 2).sum(axis=1), starts))
    return 0.5 * np.log((spreads[1] + 1e-30) / (spreads[0] + 1e-30))
