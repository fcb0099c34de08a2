"""Whether the two cameras of a stereo pair sit as a pair does, and in metres."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Pose

SHORTEST_M, LONGEST_M = 0.005, 2.0
"""Baselines of nearly all stereo cameras, from endoscopes to cars."""
MILLIMETRES = 20.0
"""A baseline of so many metres or more is one of so many millimetres; what is between is in other units."""


def pair_fault(left_from_right: Pose) -> str:
    """What is wrong with where the right camera of a pair sits, one clause; empty where it is to the right of the left
    one."""
    x, y, z = left_from_right.translation.tolist()
    if not np.hypot(np.hypot(x, y), z) > 0:
        return "both cameras are at one place, without a baseline"
    if abs(x) <= abs(y):
        return f"the right camera is {abs(y):.4g} m {'below' if y > 0 else 'above'} the left one, not beside it"
    if x < 0:
        return f"the cameras are exchanged: the right one is {-x:.4g} m to the left of the left one"
    return ""


def unit_note(baseline_m: float) -> str:
    """One sentence where a baseline is not in metres, by its size, with the unit that is likely; empty elsewhere."""
    size = abs(baseline_m)
    if not size or SHORTEST_M <= size <= LONGEST_M:
        return ""
    if size < SHORTEST_M:
        return f"the baseline is {size:.4g} m, shorter than any stereo camera's: lengths are likely not in metres"
    if size >= MILLIMETRES:
        return f"the baseline is {size:.4g} m: it is likely in millimetres ({size / 1000:.4g} m), give metres"
    return (
        f"the baseline is {size:.4g} m: it is likely in squares of the board, in centimetres ({size / 100:.3g} m) "
        f"or in inches ({size * 0.0254:.3g} m), give metres"
    )
