"""Scale transfer from triple to triple (section 6.1, step 5; Fig. 4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper import checks
from ispom.estimators.paper.monocular.window import KeyFrameWindow
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.solvers.multiview.triple import ScaleTransfer, Triple, depth_ratio, step_length
from ispom.types import Decision

DOUBTFUL_SPREAD = 20.0
"""[%] The paper has no threshold for how far the points may disagree on the unit; this one only marks doubtful ones."""
LEAST_LENGTH = 0.05
"""A |T13| - |T12| below this share of |T13 - T12| (on a sharp bend even negative) would make the unit vanish."""
SHORTEST = 1e-6
"""|T12| of a triple whose |T13| is 1: no division by zero where the first two key frames coincide."""


@dataclass(frozen=True)
class ScaleStep:
    """What the next triple needs of this one, in the world's unit."""

    length: float
    """|T23| by the chosen formula: the next triple's |T12|."""
    bias: float = 1.0
    """That length per |T13 - T12|."""

    def measured(self, keys: tuple[TrackedFrame, ...]) -> ScaleStep:
        """With the length taken from the adjusted key frames, the formula's bias kept."""
        second, third = keys[-2].world_from_camera, keys[-1].world_from_camera
        assert second is not None and third is not None
        return replace(self, length=self.bias * float(np.linalg.norm(third.translation - second.translation)))


def transfer_scale(
    triple: Triple, ids: NDArray[np.int64], window: KeyFrameWindow, last: ScaleStep | None, transfer: ScaleTransfer
) -> tuple[ScaleStep, float, tuple[Decision, ...]]:
    """What the next triple needs, world units per unit of this triple, and the decisions."""
    t12 = float(np.linalg.norm(triple.t12))
    true_length, length = step_length(triple, "vector"), step_length(triple, transfer)
    because, shared = "", None if window.fresh else _shared(triple, ids, window)
    if length <= LEAST_LENGTH * true_length:
        because = f"|T13| - |T12| = {length:.3f} cannot be a length here: |T13 - T12| used"
        length = true_length
    if last is None:
        scale, because = 1.0, "first triple, whose |T13| is the unit"
    elif transfer == "unit":
        scale = 1 / max(t12, SHORTEST)
    else:
        scale = last.length / max(t12, SHORTEST)
        if transfer == "depth" and shared is not None:
            scale, because = shared.applied(scale)
    decision = checks.SCALE_TRANSFER.of(scale, 0.0, f"{transfer}; {because}" if because else transfer)
    return ScaleStep(scale * length, length / true_length), scale, (decision, *_spread(shared, scale))


@dataclass(frozen=True)
class SharedDepths:
    """What points of the triple before say of the unit, by their depths."""

    ratio: float
    """World units per unit of this triple, the median; NaN with too few points."""
    deviation: float
    """Of the logarithm of one point's ratio."""
    count: int

    def applied(self, fallback: float) -> tuple[float, str]:
        """The unit, and why."""
        if not np.isfinite(self.ratio):
            return fallback, f"only {self.count} shared points: |T23| used"
        return self.ratio, f"{self.count} shared points, scatter {100 * self.deviation:.1f} %"


def _spread(shared: SharedDepths | None, scale: float) -> tuple[Decision, ...]:
    """Whether the shared points agree on the factor, beside the one that was used."""
    if shared is None or not np.isfinite(shared.ratio):
        return ()
    they = f"{shared.count} ratios suggest ×{shared.ratio:.3g}, used ×{scale:.3g}"
    return (checks.SCALE_SPREAD.of(100 * shared.deviation, DOUBTFUL_SPREAD, they),)


def _shared(triple: Triple, ids: NDArray[np.int64], window: KeyFrameWindow) -> SharedDepths:
    world_from_first = window.keys[-2].world_from_camera
    assert world_from_first is not None
    place = window.landmarks.places(ids)
    shared = (place >= 0) & triple.resected
    known = world_from_first.inverse().apply(window.landmarks.xyz[place[shared]])[:, 2]
    ratio, deviation = depth_ratio(known, triple.xyz_in_first[shared][:, 2])
    return SharedDepths(ratio, deviation, int(shared.sum()))
