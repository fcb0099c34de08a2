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
) -> tuple[ScaleStep, float, Decision]:
    """What the next triple needs, world units per unit of this triple, and the decision."""
    t12 = float(np.linalg.norm(triple.t12))
    true_length, length = step_length(triple, "vector"), step_length(triple, transfer)
    because = ""
    if length <= LEAST_LENGTH * true_length:
        because = f"|T13| - |T12| = {length:.3f} cannot be a length here: |T13 - T12| used"
        length = true_length
    if last is None:
        scale, because = 1.0, "first triple: |T13| is the unit"
    elif transfer == "unit":
        scale = 1 / max(t12, SHORTEST)
    else:
        scale = last.length / max(t12, SHORTEST)
        if transfer == "depth" and not window.fresh:
            scale, because = _by_depth(triple, ids, window, scale)
    decision = checks.SCALE_TRANSFER.of(scale, 0.0, f"{transfer}; {because}" if because else transfer)
    return ScaleStep(scale * length, length / true_length), scale, decision


def _by_depth(triple: Triple, ids: NDArray[np.int64], window: KeyFrameWindow, fallback: float) -> tuple[float, str]:
    world_from_first = window.keys[-2].world_from_camera
    assert world_from_first is not None
    place = window.landmarks.places(ids)
    shared = (place >= 0) & triple.resected
    known = world_from_first.inverse().apply(window.landmarks.xyz[place[shared]])[:, 2]
    ratio, deviation = depth_ratio(known, triple.xyz_in_first[shared][:, 2])
    if not np.isfinite(ratio):
        return fallback, f"only {int(shared.sum())} shared points: |T23| used"
    return ratio, f"{int(shared.sum())} shared points, spread {100 * deviation:.1f} %"
