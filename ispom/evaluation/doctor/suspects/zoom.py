"""A zoom or a crop that jumps: from a frame to the next the whole image is larger, everywhere by the same share.

A camera that moves forward makes near objects grow faster than far ones, and does so in all frames. A slow zoom is not
found: during a motion, tracks fit without it as well.
"""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array

from ..examination import Examination
from ..finding import Finding, Suspect

GROWS = 0.03
"""Least logarithm of the growth of the image between two frames that is a jump."""
ALONE = 5.0
"""A jump is at least this multiple of the growth between any other two frames."""
EVEN = 4.0
"""A jump is at least this multiple of the scatter of the growth over the image."""
LEAST_CORNERS, PAIRS, APART = 30, 600, 0.12
"""Least number of corners for a measurement of the growth; most pairs of them; least distance of the corners of a pair,
relative to the image's width."""
LEAST_STEPS = 8
EVEN_TIMES = 1.5
"""Multiple of the usual interval above which an interval is a gap: the camera has moved meanwhile."""


def zoom_jumps(seen: Examination) -> Finding | None:
    """Compares the largest growth of the image between two frames with that between the others. None where too few
    corners are followed."""
    uv, shots = seen.tracked.uv, seen.main_shots
    steps_ns = np.diff([shot.time_ns for shot in shots])
    far_px = APART * seen.rig.camera(seen.main).width
    found = [
        (growth[0], growth[1], f + 1)
        for f in range(len(shots) - 1)
        if steps_ns[f] <= EVEN_TIMES * np.median(steps_ns) and (growth := growth_of(uv[:, f], uv[:, f + 1], far_px))
    ]
    if len(found) < LEAST_STEPS:
        return None
    sizes = np.abs([growth for growth, _, _ in found])
    k = int(sizes.argmax())
    growth, spread, frame = found[k]
    other = float(np.delete(sizes, k).max())
    percent, others, even = (100 * float(np.expm1(value)) for value in (growth, other, spread))
    return Finding(
        min(sizes[k] / GROWS, sizes[k] / max(ALONE * other, 1e-6), sizes[k] / max(EVEN * spread, 1e-6)),
        f"From one frame to the next the image changes its size by {percent:+.1f} %, everywhere alike (three quarters "
        f"within {even:.1f} %), and by at most {others:.1f} % between other frames.",
        {"growth_percent": percent, "spread_percent": even, "others_percent": others},
        (shots[frame].index,),
    )


def growth_of(before: Array, after: Array, far_px: float) -> tuple[float, float] | None:
    """Returns the median logarithm of the growth of distances between corners (P, 2), which are NaN where not observed,
    and the difference from it within which three quarters of them are; None with too few corners."""
    both = np.isfinite(before[:, 0]) & np.isfinite(after[:, 0])
    if both.sum() < LEAST_CORNERS:
        return None
    a, b = before[both], after[both]
    i, j = np.random.default_rng(0).integers(0, len(a), (2, PAIRS))
    first, second = (np.linalg.norm(uv[i] - uv[j], axis=1) for uv in (a, b))
    far = (first > far_px) & (second > 0)
    if far.sum() < LEAST_CORNERS:
        return None
    logs = np.log(second[far] / first[far])
    middle = float(np.median(logs))
    return middle, float(np.percentile(np.abs(logs - middle), 75))


ZOOM = Suspect(
    "zoom",
    "a zoom or a crop jumps",
    "tracks",
    "Fix the zoom, and switch off what crops or stabilises images. With images that exist: run the parts before and "
    "after that frame on their own, each with its own calibration.",
    zoom_jumps,
)
