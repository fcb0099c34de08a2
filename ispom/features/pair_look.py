"""Checks that the first images of a recording fit its cameras, to report mistakes of the user at once.

The checks use matched features. In a rectified pair they are on the same rows, and farther left in the right image, but
only in images of the same time (pair_rows.py). In the image of a single camera the two halves have no matches.
"""

from __future__ import annotations

import numpy as np

from ispom.errors import InputError
from ispom.features.images import TrackedSize
from ispom.features.pair_rows import (
    FLIP_TOLERANCE,
    LEVEL_PX,
    LEVEL_SHARE,
    LEVELLED_DEG,
    LEVELLED_PX,
    MIN_MATCHES,
    Look,
    Matches,
    RowModel,
    features_of,
    matched,
    moments,
)
from ispom.features.row_search import PointSearch
from ispom.plausibility.doubt import Doubt
from ispom.plausibility.film import Film
from ispom.plausibility.images import image_doubts
from ispom.types import FRAME_KINDS, Frame, Image, Sequence, as_grey, images_of, is_stereo, is_video

SAMPLED_IMAGES = 5
"""Number of images of each camera that are checked, for any length of the recording."""
FILM_PIXELS, FILM_IMAGES = 12_000_000, 150
"""Largest number of pixels, and of first images of a film, that are compared with their neighbours: 39 images of
640 x 480."""
CHECKED_NEIGHBOURS = 2
"""Number of neighbouring frames that are checked at the start, in the middle and at the end of a recording of pairs."""
MIN_SIDE_PX = 64
"""Least number of columns or rows [px] for a check."""
MAX_ROW_OFFSET = 2.0
"""Row offset, relative to the search range, above which it is reported: methods that do not level the pair find next to
nothing. `stereo` and `integrated` correct more than that, see LEVELLED_PX."""
SIDE_PX, SIDE_SHARE = 1.0, 0.8
"""Least shift to the right [px], and least share of matches beyond it, if left and right are exchanged; smaller shifts
may be errors of the calibration."""

HALF_SHARE, HALF_LEVEL, HALF_LOWER, HALF_APART = 0.2, 0.015, 0.1, 0.35
"""Limits for two cameras in one image: least share of features matched in the other half; largest scatter of the row
offset and largest row offset, relative to the height; largest column offset, relative to a half's width. For images of
one camera the share was 0.01."""

SIDE_BY_SIDE = (
    "The left and the right half of the images show the same, as of a stereo camera that puts its images side by side: "
    "write a rig.yaml of both cameras, and a sequence.yaml with left: {source: FILM, half: left} and right: "
    "{source: FILM, half: right}; to calibrate, cut them apart (ffmpeg -i FILM -vf crop=iw/2:ih:0:0 left.mp4, and "
    "crop=iw/2:ih:iw/2:0 right.mp4)."
)
ONE_ABOVE_OTHER = (
    "The upper and the lower half of the images show the same, as of a stereo camera that puts its images one above "
    "the other: write a rig.yaml of both cameras, and a sequence.yaml with left: {source: FILM, half: top} and right: "
    "{source: FILM, half: bottom}; to calibrate, cut them apart (ffmpeg -i FILM -vf crop=iw:ih/2:0:0 left.mp4, and "
    "crop=iw:ih/2:0:ih/2 right.mp4)."
)
SAME = "The left and the right images are the same: there is no depth in them; give those of the right camera."
EXCHANGED = (
    "Left and right seem to be exchanged: common points are farther right in the right images; name them the "
    "other way round."
)

UPSIDE = "The right images are upside down relative to the left ones: rotate them by 180 degrees."
MIRRORED = (
    "The right images are mirrored left-right relative to the left ones: mirror them back (ffmpeg -i FILM -vf hflip "
    "right.mp4), or give those as the camera took them."
)
MIRRORED_UPSIDE = (
    "The right images are mirrored top-bottom relative to the left ones: mirror them back (ffmpeg -i FILM -vf vflip "
    "right.mp4), or give those as the camera took them."
)

Place = tuple[int, Look, Look]
"""The number of a pair, the pair, and the next one."""

MIXED_UP = (SIDE_BY_SIDE, ONE_ABOVE_OTHER, SAME, EXCHANGED, UPSIDE, MIRRORED, MIRRORED_UPSIDE)
"""Notes about images from which no method can estimate a motion."""


def with_look(sequence: Sequence) -> Sequence:
    """Adds a note to the sequence if its first images do not fit the cameras of its rig.

    Live sources are not checked.
    """
    if sequence.grow is not None:
        return sequence
    sequence = _of_film(sequence.with_notes(_of_images(sequence)))
    kind = "stereo" if sequence.rig.has_stereo else "video"
    found = [i for i, each in enumerate(sequence.kinds) if each == kind]
    try:
        seen = [sequence.load(i) for i in found[:CHECKED_NEIGHBOURS]]
        if kind == "video":
            return sequence.with_notes(_given(halves_note([each.image for each in seen if is_video(each)])))
        pairs = [each for each in seen if is_stereo(each)]
        px, looks = float(TrackedSize.of(sequence.rig.camera("left")).factors[1]), list(map(Look.of, pairs))
        note = pair_note(pairs, px, looks)
        if not note and len(looks) == CHECKED_NEIGHBOURS and len(found) >= 2 * CHECKED_NEIGHBOURS:

            def place(start: int) -> Place:
                both = (sequence.load(i) for i in found[start : start + CHECKED_NEIGHBOURS])
                first, second = (Look.of(each) for each in both if is_stereo(each))
                return start, first, second

            middle, last = (len(found) - CHECKED_NEIGHBOURS) // 2, len(found) - CHECKED_NEIGHBOURS
            places: list[Place] = [(0, looks[0], looks[1]), place(last)]
            note = moments_note(places, px)
            if note and middle:
                note = moments_note([places[0], place(middle), places[1]], px) or note
    except InputError:  # the run reports it, or continues without it
        return sequence
    return sequence.with_notes(_given(note))


def _given(note: str) -> tuple[str, ...]:
    return (Doubt("pair_unlike", note),) if note else ()


def _of_images(sequence: Sequence) -> tuple[str, ...]:
    """Returns doubts about SAMPLED_IMAGES images of each camera, from the first to the last."""
    out: dict[str, str] = {}
    kinds, rig = FRAME_KINDS & set(sequence.kinds), sequence.rig
    if "stereo" in kinds and np.array_equal(rig.rig_from_video.matrix, rig.rig_from_left.matrix):
        kinds -= {"video"}  # the same as the left images
    for kind in sorted(kinds):
        found = [i for i, each in enumerate(sequence.kinds) if each == kind]
        by_camera: dict[str, list[Image]] = {}
        for k in np.unique(np.linspace(0, len(found) - 1, SAMPLED_IMAGES).astype(int)).tolist():
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


def _of_film(sequence: Sequence) -> Sequence:
    """Returns the sequence with notes about the first images of a film, and without a title at its start."""
    kind = "video" if "video" in sequence.kinds else "stereo"
    found, film, pixels = [i for i, each in enumerate(sequence.kinds) if each == kind], Film(), 0
    try:
        for i in found[:FILM_IMAGES]:
            image = next(iter(images_of(sequence.load(i)).values()))
            pixels += image.shape[0] * image.shape[1]
            if pixels > FILM_PIXELS:
                break
            film.add(image, int(sequence.times_ns[i]))
    except InputError:  # the run skips it
        return sequence
    alone = set(sequence.kinds) == {"video"}
    doubts, begin = film.doubts(f"{sequence.name}: {kind}", alone)
    sequence = sequence.with_notes(doubts)
    return sequence.part(begin, len(sequence) - 1) if begin else sequence


def halves_note(images: list[Image]) -> str:
    """Returns a note if each image contains those of two cameras, side by side or one above the other; "" if not, or
    unknown."""
    if images and all(map(_is_two, images)):
        return SIDE_BY_SIDE
    return ONE_ABOVE_OTHER if images and all(_is_two(image, above=True) for image in images) else ""


def pair_note(pairs: list[Frame], px_per_tracked: float = 1.0, looks: list[Look] | None = None) -> str:
    """Returns a note about a mistake in the stereo frames; "" if there is none, or unknown.

    `px_per_tracked` is the number of pixels of these images per pixel of the tracked ones; `looks` are those of the
    pairs, if they were made before.
    """
    if pairs and all(np.array_equal(pair.left, pair.right) and np.ptp(pair.left) for pair in pairs):
        return SAME
    looks = list(map(Look.of, pairs)) if looks is None else looks
    both = _joined([look.matches() for look in looks])
    if both is None:
        return _of_mirrored(looks)
    px = looks[0].px
    within = LEVEL_PX * px_per_tracked / px
    model = RowModel.of(both, within)
    level = np.abs(model.residuals(both)) <= within
    if level.mean() < LEVEL_SHARE:
        return ""
    if abs(model.larger + 2) < FLIP_TOLERANCE:
        return UPSIDE
    if abs(model.larger) > FLIP_TOLERANCE:
        return ""
    if (both.offsets[level, 0] * px > SIDE_PX).mean() > SIDE_SHARE:
        return EXCHANGED
    limit = PointSearch().max_row_error_px * px_per_tracked
    lower, half_px = model.lower_px * px, (both.size[0] * px / 2, both.size[1] * px / 2)
    search = f"points are found within {limit:g} px"
    levelled = (
        f"`stereo` and `integrated` correct up to {LEVELLED_PX * px_per_tracked:g} px and {LEVELLED_DEG:g} degrees by "
        f"themselves, for the other methods {search}"
    )
    if abs(lower) > MAX_ROW_OFFSET * limit:
        return (
            f"The right images lie {abs(lower):.1f} px {'lower' if lower > 0 else 'higher'} than the left ones: "
            f"{levelled}. Calibrate the pair, or rectify it again."
        )
    if abs(model.turn_rad) * half_px[0] > limit:
        side = "clockwise" if model.turn_rad > 0 else "anticlockwise"
        return (
            f"The right images are turned by {np.degrees(abs(model.turn_rad)):.2g} degrees {side} against the left "
            f"ones ({abs(model.turn_rad) * half_px[0]:.1f} px at the border): {levelled}. Calibrate the pair, or "
            "rectify it again."
        )
    if abs(model.larger) * half_px[1] > MAX_ROW_OFFSET * limit:
        return (
            f"The right images show the scene {abs(model.larger):.1%} {'larger' if model.larger > 0 else 'smaller'} "
            f"than the left ones ({abs(model.larger) * half_px[1]:.1f} px at the border, and {search}): calibrate the "
            "pair, or rectify it again."
        )
    return ""


def moments_note(places: list[Place], px_per_tracked: float = 1.0) -> str:
    """Returns a note about pairs whose images are of different times; "" if all are of the same time, or if it is
    unknown, as without motion."""
    lags = moments([(first, second) for _, first, second in places], LEVEL_PX * px_per_tracked)
    found = [(start, each) for (start, *_), each in zip(places, lags, strict=True) if each]
    off = [(start, each) for start, each in found if each.later]
    if not off or len({each.later for _, each in off}) > 1:
        return ""
    first, moment = off[0]
    what = "the frame after" if moment.later > 0 else "the frame before"
    rows = f"rows of matches scatter by {moment.scatter_px:.1f} px; {moment.best_px:.1f} px with the other image"
    together = [start for start, each in found if not each.later]
    if not together:
        return (
            f"Each pair is of two moments: its right image shows {what} ({rows}). Move the images of one side by one, "
            "or correct their times."
        )
    if max(together) > first:
        return ""
    side = "right" if moment.later > 0 else "left"
    return (
        f"Pairs are of two moments from one between {max(together) + 1} and {first} on: an image of the {side} camera "
        f"is missing there, though names or times count on, and the right image shows {what} ({rows}). Remove the "
        "image of the other side that has no partner, or give the times of both."
    )


def _joined(found: list[Matches]) -> Matches | None:
    """Returns all matches of some pairs; None where they are too few."""
    if sum(map(len, found)) < MIN_MATCHES:
        return None
    left, right = np.concatenate([each.left for each in found]), np.concatenate([each.right for each in found])
    return Matches(left, right, found[0].size)


def _of_mirrored(looks: list[Look]) -> str:
    """Returns a note about right images that are mirrored; descriptors of features find them only when they are
    mirrored back."""
    both = _joined([look.mirrored.matches() for look in looks])
    if both is None:
        return ""
    model = RowModel.of(both, LEVEL_PX)
    if (np.abs(model.residuals(both)) <= LEVEL_PX).mean() < LEVEL_SHARE:
        return ""
    if abs(model.larger + 2) < FLIP_TOLERANCE:
        return MIRRORED_UPSIDE
    return MIRRORED if abs(model.larger) < FLIP_TOLERANCE else ""


def _is_two(image: Image, above: bool = False) -> bool:
    image = np.ascontiguousarray(as_grey(image))
    side = image.shape[0 if above else 1] // 2
    if side < MIN_SIDE_PX:
        return False
    halves = (image[:side], image[side : 2 * side]) if above else (image[:, :side], image[:, side : 2 * side])
    height, width = halves[0].shape
    first, second = (features_of(np.ascontiguousarray(half)) for half in halves)
    offsets = matched(first, second, halves[0].shape).offsets
    if not len(offsets):
        return False
    lower = float(np.median(offsets[:, 1]))
    level = np.abs(offsets[:, 1] - lower) <= HALF_LEVEL * height
    near = level & (np.abs(offsets[:, 0]) <= HALF_APART * width) & (abs(lower) <= HALF_LOWER * height)
    return int(near.sum()) >= max(MIN_MATCHES, HALF_SHARE * len(first.uv)) and near.mean() >= LEVEL_SHARE
