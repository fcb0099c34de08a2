"""Whether the first pairs of a recording look like those of a stereo camera: what a person mixes up is told at once.

Features found again in the other image tell it: of a rectified pair they are on the same rows, and farther left in the
right image.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.errors import InputError
from ispom.frontends.row_search import PointSearch
from ispom.frontends.sift import detect_and_describe, match
from ispom.frontends.tracked_size import TrackedSize
from ispom.geometry import Array
from ispom.types import Sequence, StereoPair, as_grey

PAIRS, FEATURES = 2, 500
"""Looked at, and in each of their images."""
LEAST = 60
"""Fewer matches say nothing."""
FAR_OFF = 2.0
"""Rows may be off by so many times what stereo looks within before most points are missed: it corrects what is less."""
LEVEL_PX, LEVEL_SHARE = 2.0, 0.6
"""So many matches differ in rows by no more than this from all others, or the images are not those of one place."""
SIDE_PX, SIDE_SHARE = 1.0, 0.8
"""So many matches are farther right by more than this, or left and right are not exchanged: calibrations are off."""

SAME = "The left and the right images are the same: there is no depth in them; give those of the right camera."
EXCHANGED = (
    "Left and right seem to be exchanged: what both cameras see lies farther right in the right images; name them the "
    "other way round."
)


def with_pair_note(sequence: Sequence) -> Sequence:
    """The same, with a note where its first pairs cannot be those of the stereo camera that its rig has.

    Of a live source nothing is looked at.
    """
    if sequence.grow is not None or not sequence.rig.has_stereo:
        return sequence
    found = [i for i, kind in enumerate(sequence.kinds) if kind == "stereo"][:PAIRS]
    try:
        pairs = [pair for i in found if isinstance(pair := sequence.load(i), StereoPair)]
    except InputError:  # the run tells of it, or goes on without
        return sequence
    size = TrackedSize.of(sequence.rig.camera("left"))
    note = pair_note(pairs, float(size.factors[1]))
    return replace(sequence, notes=(*sequence.notes, note)) if note else sequence


def pair_note(pairs: list[StereoPair], px_per_tracked: float = 1.0) -> str:
    """What is wrong with pairs, in words; "" where nothing is, or where that cannot be told. Stereo tracks in images
    that are smaller by `px_per_tracked`."""
    if pairs and all(np.array_equal(pair.left, pair.right) and np.ptp(pair.left) for pair in pairs):
        return SAME
    apart = np.concatenate([np.zeros((0, 2)), *map(_apart, pairs)])
    if len(apart) < LEAST:
        return ""
    lower = float(np.median(apart[:, 1]))
    level = np.abs(apart[:, 1] - lower) <= LEVEL_PX * px_per_tracked
    if level.mean() < LEVEL_SHARE:
        return ""
    if (apart[level, 0] > SIDE_PX).mean() > SIDE_SHARE:
        return EXCHANGED
    limit = PointSearch().max_row_error_px * px_per_tracked
    if abs(lower) <= FAR_OFF * limit:
        return ""
    return (
        f"The right images lie {abs(lower):.1f} px {'lower' if lower > 0 else 'higher'} than the left ones, and stereo "
        f"finds those within {limit:g} px: calibrate the pair, or rectify it anew."
    )


def _apart(pair: StereoPair) -> Array:
    """(M, 2) [px] how much farther right, and lower, features lie in the right image."""
    left, right = (detect_and_describe(as_grey(image), FEATURES) for image in (pair.left, pair.right))
    pairs = match(left, right, 0.8)
    return (right.uv[pairs[:, 1]] - left.uv[pairs[:, 0]]).astype(float)
