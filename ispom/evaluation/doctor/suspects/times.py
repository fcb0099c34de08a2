"""Suspects that the time stamps and equal images show: lost frames and repeated ones."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..examination import Examination
from ..finding import Finding, Suspect

GAP = 1.6
"""Multiple of the usual interval from which on an interval is a gap: at least one frame is missing."""
GAP_SHARE = 0.05
"""Share of missing frames from which on they are a cause."""
SAME_LEVELS = 0.4
"""Mean absolute difference [grey levels] below which two images are one: the noise of a sensor gives more."""
USUAL_SHARE = 0.1
"""The difference of two images that are one is below this share of those of the liveliest frames, too: in a compressed
film of a scene at rest, all images differ by little."""
SAME_SHARE = 0.05


def dropped(seen: Examination) -> Finding | None:
    """Counts the frames that are missing by the usual interval of the main camera."""
    times_ns = np.array([shot.time_ns for shot in seen.main_shots], np.int64)
    if len(times_ns) < 4:
        return None
    intervals = np.diff(times_ns) * 1e-9
    usual = float(np.percentile(np.diff(seen.times_ns) * 1e-9, 25))  # gaps in a third of the frames leave it
    if usual <= 0:
        return None
    steps = np.where(intervals > GAP * usual, np.rint(intervals / usual), 1)
    missing, share = int((steps - 1).sum()), float((steps - 1).sum() / steps.sum())
    worst = np.argsort(-steps, kind="stable")[:3]
    return Finding(
        share / GAP_SHARE,
        f"{missing} of {int(steps.sum())} frames are missing by their time stamps, and the longest gap is "
        f"{1000 * intervals.max():.0f} ms where the usual interval is {1000 * usual:.0f} ms.",
        {"missing_share": share, "longest_gap_s": float(intervals.max()), "interval_s": usual},
        tuple(seen.main_shots[int(i) + 1].index for i in worst if steps[i] > 1),
    )


def repeated(seen: Examination) -> Finding | None:
    """Counts frames with the image of the one before, while others differ."""
    images = [shot.images[seen.main].astype(np.int16) for shot in seen.main_shots]
    if len(images) < 4:
        return None
    differences = np.array([np.abs(b - a).mean() for a, b in pairwise(images)])
    same = differences < min(SAME_LEVELS, max(USUAL_SHARE * float(np.percentile(differences, 90)), 1e-9))
    share = float(same.mean())
    shown = tuple(seen.main_shots[int(i) + 1].index for i in np.flatnonzero(same)[:3])
    return Finding(
        share / SAME_SHARE,
        f"{int(same.sum())} of {len(same)} frames show the same image as the frame before, with a new time stamp.",
        {"same_share": share},
        shown,
    )


TIMES = (
    Suspect(
        "dropped-frames",
        "frames are missing",
        "times",
        "Give the film with all of its images: one that was thinned or cut lacks some. Where it was recorded so, "
        "record at a lower resolution, or to a faster disk.",
        dropped,
    ),
    Suspect(
        "repeated-frames",
        "frames repeat the image before",
        "images",
        "Remove the repeated frames, or record at the rate that the camera really has; a converted video often repeats "
        "frames.",
        repeated,
    ),
)
