"""Whether the first images of a recording look like those of the cameras that it has: what a person mixes up is told
at once.

Features found again in the other image tell it: of a rectified pair they are on the same rows, and farther left in the
right image; those of one camera are not found again in the other half of its image.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.errors import InputError
from ispom.features.images import TrackedSize
from ispom.features.row_search import PointSearch
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array
from ispom.types import Frame, Image, Sequence, as_grey, is_stereo, is_video

PAIRS, FEATURES = 2, 500
"""Looked at, and in each of their images."""
LEAST, LEAST_PX = 60, 64
"""Fewer matches, or columns, say nothing."""
FAR_OFF = 2.0
"""Rows may be off by so many times what stereo looks within before most points are missed: it corrects what is less."""
LEVEL_PX, LEVEL_SHARE = 2.0, 0.6
"""So many matches differ in rows by no more than this from all others, or the images are not those of one place."""
SIDE_PX, SIDE_SHARE = 1.0, 0.8
"""So many matches are farther right by more than this, or left and right are not exchanged: calibrations are off."""

HALF_SHARE, HALF_LEVEL, HALF_LOWER, HALF_APART = 0.2, 0.015, 0.1, 0.35
"""Of the features in one half of an image so many are found again in the other half, lower by the same to this share of
the height and by no more than that one, and no farther apart than this share of a half's width. Of the images of one
camera it was 0.01."""

SIDE_BY_SIDE = (
    "The left and the right half of the images show the same, as of a stereo camera that puts its images side by side: "
    "cut them apart (ffmpeg -i FILM -vf crop=iw/2:ih:0:0 left.mp4, and crop=iw/2:ih:iw/2:0 right.mp4), calibrate the "
    "pair, and name both films in a sequence.yaml."
)
SAME = "The left and the right images are the same: there is no depth in them; give those of the right camera."
EXCHANGED = (
    "Left and right seem to be exchanged: what both cameras see lies farther right in the right images; name them the "
    "other way round."
)

MIXED_UP = (SIDE_BY_SIDE, SAME, EXCHANGED)
"""Of such images no method finds any motion."""


def with_look(sequence: Sequence) -> Sequence:
    """The same, with a note where its first images cannot be those of the cameras that its rig has.

    Of a live source nothing is looked at.
    """
    if sequence.grow is not None:
        return sequence
    kind = "stereo" if sequence.rig.has_stereo else "video"
    found = [i for i, each in enumerate(sequence.kinds) if each == kind][:PAIRS]
    try:
        seen = [sequence.load(i) for i in found]
    except InputError:  # the run tells of it, or goes on without
        return sequence
    if kind == "video":
        note = halves_note([each.image for each in seen if is_video(each)])
    else:
        size = TrackedSize.of(sequence.rig.camera("left"))
        note = pair_note([each for each in seen if is_stereo(each)], float(size.factors[1]))
    return replace(sequence, notes=(*sequence.notes, note)) if note else sequence


def halves_note(images: list[Image]) -> str:
    """That images hold those of two cameras side by side, in words; "" where they do not, or where that cannot be
    told."""
    return SIDE_BY_SIDE if images and all(map(_is_two, images)) else ""


def pair_note(pairs: list[Frame], px_per_tracked: float = 1.0) -> str:
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


def _apart(pair: Frame) -> Array:
    """(M, 2) [px] how much farther right, and lower, features lie in the right image."""
    return _found_again(as_grey(pair.left), as_grey(pair.right))[0]


def _is_two(image: Image) -> bool:
    half = image.shape[1] // 2
    if half < LEAST_PX:
        return False
    apart, features = _found_again(as_grey(image[:, :half]), as_grey(image[:, half : 2 * half]))
    if not len(apart):
        return False
    lower = float(np.median(apart[:, 1]))
    level = np.abs(apart[:, 1] - lower) <= HALF_LEVEL * image.shape[0]
    near = level & (np.abs(apart[:, 0]) <= HALF_APART * half) & (abs(lower) <= HALF_LOWER * image.shape[0])
    return int(near.sum()) >= max(LEAST, HALF_SHARE * features) and near.mean() >= LEVEL_SHARE


def _found_again(left: Image, right: Image) -> tuple[Array, int]:
    """(M, 2) [px] how much farther right, and lower, features lie in the right image; and of how many."""
    a, b = (SIFT.detect_and_describe(np.ascontiguousarray(image), FEATURES) for image in (left, right))
    pairs = SIFT_MATCHER.match(a, b)
    return (b.uv[pairs[:, 1]] - a.uv[pairs[:, 0]]).astype(float), len(a.uv)
