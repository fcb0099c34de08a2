"""Checks that the first images of a recording fit its cameras, to report mistakes of the user at once.

Matched features decide. In a rectified pair they are on the same rows, and farther left in the right image. In one
camera's image the two halves have no matches.
"""

from __future__ import annotations

import numpy as np

from ispom.errors import InputError
from ispom.features.images import TrackedSize
from ispom.features.row_search import PointSearch
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array
from ispom.plausibility.images import image_doubts
from ispom.types import FRAME_KINDS, Frame, Image, Sequence, as_grey, images_of, is_stereo, is_video

SAMPLES = 5
"""Images of each camera that are looked at, whatever the recording's length."""
PAIRS, FEATURES = 2, 500
"""Number of frames that are checked, and of features in each image."""
LEAST, LEAST_PX = 60, 64
"""Least number of matches, and of columns [px], for a check."""
FAR_OFF = 2.0
"""Row offset, relative to the search range of stereo, from which most points are missed; stereo corrects smaller
ones."""
LEVEL_PX, LEVEL_SHARE = 2.0, 0.6
"""Largest difference of a match's row offset [px] from the median, and the least share of matches within it; with fewer
the images do not show the same scene."""
SIDE_PX, SIDE_SHARE = 1.0, 0.8
"""Least shift to the right [px], and the share of matches beyond it from which left and right count as exchanged:
calibrations are inaccurate."""

HALF_SHARE, HALF_LEVEL, HALF_LOWER, HALF_APART = 0.2, 0.015, 0.1, 0.35
"""Limits for two cameras in one image: least share of features matched in the other half; largest scatter of the row
offset and largest row offset, relative to the height; largest column offset, relative to a half's width. For images of
one camera the share was 0.01."""

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
"""Notes about images from which no method can estimate a motion."""


def with_look(sequence: Sequence) -> Sequence:
    """Adds a note to the sequence if its first images do not fit the cameras of its rig.

    Live sources are not checked.
    """
    if sequence.grow is not None:
        return sequence
    sequence = sequence.with_notes(_of_images(sequence))
    kind = "stereo" if sequence.rig.has_stereo else "video"
    found = [i for i, each in enumerate(sequence.kinds) if each == kind][:PAIRS]
    try:
        seen = [sequence.load(i) for i in found]
    except InputError:  # the run reports it, or continues without it
        return sequence
    if kind == "video":
        note = halves_note([each.image for each in seen if is_video(each)])
    else:
        size = TrackedSize.of(sequence.rig.camera("left"))
        note = pair_note([each for each in seen if is_stereo(each)], float(size.factors[1]))
    return sequence.with_notes((note,)) if note else sequence


def _of_images(sequence: Sequence) -> tuple[str, ...]:
    """Doubts about SAMPLES images of each camera, from the first to the last."""
    out: dict[str, str] = {}
    kinds, rig = FRAME_KINDS & set(sequence.kinds), sequence.rig
    if "stereo" in kinds and np.array_equal(rig.rig_from_video.matrix, rig.rig_from_left.matrix):
        kinds -= {"video"}  # the left images, once more
    for kind in sorted(kinds):
        found = [i for i, each in enumerate(sequence.kinds) if each == kind]
        by_camera: dict[str, list[Image]] = {}
        for k in np.unique(np.linspace(0, len(found) - 1, SAMPLES).astype(int)).tolist():
            try:
                images = images_of(sequence.load(found[k]))
            except InputError:  # the run skips it
                continue
            for camera, image in images.items():
                by_camera.setdefault(camera, []).append(image)
        for camera, images in by_camera.items():
            for doubt in image_doubts(f"{sequence.name}: {camera}", images):
                out.setdefault(doubt.key, doubt)
    return tuple(out.values())


def halves_note(images: list[Image]) -> str:
    """Returns a note if each image contains those of two cameras side by side; "" if not, or unknown."""
    return SIDE_BY_SIDE if images and all(map(_is_two, images)) else ""


def pair_note(pairs: list[Frame], px_per_tracked: float = 1.0) -> str:
    """Returns a note about a mistake in the stereo frames; "" if there is none, or unknown.

    `px_per_tracked` is the number of pixels of these images per pixel of the tracked ones.
    """
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
    """Returns the offsets (M, 2) [px], to the right and downwards, of features in the right image."""
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
    """Returns the offsets (M, 2) [px] of matched features in the right image, and the number of left features."""
    a, b = (SIFT.detect_and_describe(np.ascontiguousarray(image), FEATURES) for image in (left, right))
    pairs = SIFT_MATCHER.match(a, b)
    return (b.uv[pairs[:, 1]] - a.uv[pairs[:, 0]]).astype(float), len(a.uv)
