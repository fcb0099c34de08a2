"""An explanation of a difference: its claim, and how much it reduces the errors of held-out blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.blocks import FEWEST_BLOCKS, Errors, errors, groups_of, levels
from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.samples import Path, Samples, clocks_at, samples_at
from ispom.geometry import Array

MIN_GAIN = float(np.log(1 / 0.75))
"""Least mean logarithm by which an explanation reduces the errors of blocks to which its parameters were not fitted: a
quarter. A parameter that explains nothing increases these errors. So this is no limit against chance, but the least
effect that is worth a sentence."""
MIN_GROUPS_BETTER = 0.75
"""Least share of the groups of blocks that must not become worse: a mistake of a file is in all of it, while a single
bad stretch is an error of the method."""
MIN_GROUPS = 3
"""Least number of groups whose blocks say something about an explanation."""
CHANGED = 0.1
"""Least change of a block's logarithmic error with which the block counts: a lever arm does not show on a straight
road."""
MIN_CHANGED = 0.1
"""Least share of the blocks that must say something, else all are counted."""
NO_WORSE = -0.02
"""Least gain of a group that does not contradict an explanation: that of a lever arm in a group without rotations."""
SIGNIFICANT = 3.0
"""Least size of a parameter, in standard deviations between groups."""
SAMPLES_NEEDED = 64
"""Least number of common samples: four blocks of 16."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The trajectories that are audited."""

    own: Path
    true: Path
    with_scale: bool
    """Whether the alignment takes the scale away."""
    timed: bool = True
    """Whether times are known, else they are rows: their offsets are whole numbers."""
    paired: bool = False
    """Whether poses are paired by other means than times, so that clocks say nothing."""

    def samples(self, offset_s: float = 0.0) -> Samples:
        times, good = clocks_at(self.own, self.true, offset_s)
        return samples_at(self.own, self.true, times[good], offset_s)


@dataclass(frozen=True, eq=False)
class Explanation:
    key: str
    correction: Correction
    """The correction that it claims, in addition to the earlier ones."""
    gains: tuple[Array, ...]
    """For each level: (B,) logarithms of the errors of held-out blocks without it over those with it."""
    after: tuple[Errors, ...]
    parameters: int = 0
    """Number of fitted parameters."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Fitted values, by name with unit."""
    sigmas: Mapping[str, float] = field(default_factory=dict)
    significant: bool = True
    by_motions: float | None = None
    """Mean gain of motions that name it, where these show it better than blocks do."""

    @property
    def level(self) -> int:
        """The number of the level that shows it best."""
        return int(np.argmax([informative(gain)[0] for gain in self.gains]))

    @property
    def gain(self) -> float:
        """Mean logarithm of the errors before over those after, of all blocks, where it is largest."""
        return max((float(gain.mean()) for gain in self.gains), default=0.0)

    @property
    def shown(self) -> float:
        """Mean gain of what shows it."""
        return self.by_motions if self.by_motions is not None else informative(self.gains[self.level])[0]

    @property
    def named(self) -> bool:
        """Whether it explains enough to be named."""
        if not self.gains or not self.significant:
            return False
        if self.by_motions is not None:
            return True
        gain = self.gains[self.level]
        shown, blocks = informative(gain)
        if shown < MIN_GAIN:
            return False
        group = groups_of(len(gain))
        by_group = np.array([gain[blocks & (group == g)].mean() for g in np.unique(group[blocks])])
        return len(by_group) >= MIN_GROUPS and bool((by_group >= NO_WORSE).mean() >= MIN_GROUPS_BETTER)


def informative(gain: Array) -> tuple[float, NDArray[np.bool_]]:
    """Returns the mean gain of the blocks (B,) that an explanation changes, and which they are.

    Blocks that become worse count as those that become better, so that the choice favours no explanation. Where too
    few change, all blocks count.
    """
    blocks = abs(gain) > CHANGED
    if blocks.sum() < max(FEWEST_BLOCKS, MIN_CHANGED * len(gain)):
        blocks = np.ones(len(gain), bool)
    return float(gain[blocks].mean()), blocks


def errors_by_level(samples: Samples, with_scale: bool) -> list[Errors]:
    return [errors(samples, starts, with_scale) for starts in levels(len(samples))]


def without_parameters(
    key: str, before: Samples, after: Samples, with_scale: tuple[bool, bool], correction: Correction
) -> Explanation:
    """Returns the explanation by `after`, which was not fitted; the alignment has a scale before, and after."""
    pairs = zip(errors_by_level(before, with_scale[0]), errors_by_level(after, with_scale[1]), strict=True)
    both = list(pairs)
    return Explanation(key, correction, tuple(a.gain(b) for a, b in both), tuple(b for _, b in both))


def held_out(at: Callable[[Array], Errors], fits: Array, group: NDArray[np.intp]) -> Errors:
    """Returns the errors of each block with the parameters `fits` (G, K) of all groups but its own.

    `at` gives the errors of all blocks with some parameters.
    """
    by_group = [at(fit) for fit in fits]

    def chosen(parts: Sequence[Array | None]) -> Array | None:
        if any(part is None for part in parts):
            return None
        return np.array([parts[g][b] for b, g in enumerate(group)])  # type: ignore[index]

    position = chosen([e.position for e in by_group])
    assert position is not None
    return Errors(position, chosen([e.rotation for e in by_group]), chosen([e.tied for e in by_group]))


def jackknife_sigma(fits: Array) -> Array:
    """Returns standard deviations (K,) from the fits (G, K) without each group."""
    count = len(fits)
    return np.sqrt((count - 1) / count * ((fits - fits.mean(axis=0)) ** 2).sum(axis=0))
