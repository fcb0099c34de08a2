"""A triple of key frames (section 6.1, Fig. 3): C1 and C3, their points, and C2 resected from those."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper import checks
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.solvers.multiview.triple import Triple, solve_triple
from ispom.types import Decision

MIN_EPIPOLAR_SHARE = 0.5
"""Of the common points, on their epipolar lines: with fewer the relative pose explains a minority."""
MIN_RESECTED = 12
"""Points for C2: twice the least number that the resection itself takes."""


def triple_of(
    first: TrackedFrame,
    second: TrackedFrame,
    third: TrackedFrame,
    ids: NDArray[np.int64],
    limit: float,
    min_angle_rad: float,
) -> tuple[Triple | None, tuple[Decision, ...]]:
    """From the points (N,) common to the three frames; None where too few of them agree. `limit` normalised."""
    triple = solve_triple(first.at(ids), second.at(ids), third.at(ids), limit, min_angle_rad)
    epipolar = 0.0 if triple is None else float(triple.epipolar.mean())
    resected = 0 if triple is None else int(triple.resected.sum())
    made = (
        checks.EPIPOLAR_SHARE.of(epipolar, MIN_EPIPOLAR_SHARE, "" if triple else "no pose"),
        checks.RESECTED_POINTS.of(resected, MIN_RESECTED),
    )
    return (triple if all(d.passed for d in made) else None), made
