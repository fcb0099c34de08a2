"""Suspects that single images show: darkness, a covered lens, blur, haze, a scene without texture, jumps of the
exposure."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.geometry import Array
from ispom.types import Image

from ..examination import Examination
from ..finding import Finding, Suspect
from .cover import COVERED_LENS, blocks

DARK_LEVELS = 36.0
"""Mean grey level of the brighter half of a dark image: at this one, noise is a third of the texture of an ordinary
scene."""
IN_A_ROW = 3
"""Dark or blurred images that stop the tracks: one or two are passed over by most methods."""
EDGE_PX = 5.0
"""Width of the strongest edges, their step over their steepest slope, from which on an image is blurred: that of a blur
of 2 px (1 sigma). Sharp images have about 3."""
EDGES = 150
"""Strongest edges of an image that are measured."""
BLUR_SAMPLES = 20
"""Images of a camera that are measured."""
REACH_PX = 8
"""Edges are measured so far to both sides."""
HAZE_RATIO = 0.5 ** (1 / 2.2)
"""Grey level of the darkest places over that of the brightest ones, from which on an image is hazy: the places differ
by a factor of two in light, at the usual gamma of 2.2. Light and shadow on a single material differ by more."""
HAZE_SHARE = 0.01
"""Share of an image's pixels that are its darkest, and its brightest, places."""
HAZE_LASTS = 0.9
"""Share of the images that are hazy, so that it is no even place which the camera passes."""
SENSOR_NOISE_PX = 1.5
"""Smoothing (1 sigma) before the darkest and brightest places are sought: it takes most of a sensor's noise."""
BARE_STD = 4.0
"""A block with a lower standard deviation has no texture: it is hardly more than a sensor's noise."""
BARE_SHARE = 0.75
GAIN = 1.12
"""Change of the brightness of the same places, from one frame to the next, that is a jump."""
AROUND_PX = 15
"""Side of the surroundings of a corner whose brightness is compared: those by which it is followed."""
LEAST_CORNERS = 20
"""Least number of corners that are followed from a frame to the next, for a measurement of the gain."""
FOLLOWED = 0.5
"""Share of the corners that are followed, so that these are no chance: fewer say nothing, as at a low frame rate."""
GAIN_JUMPS = 1
"""Jumps in the stretch from which on they are a cause."""


def darkness(seen: Examination) -> Finding | None:
    """Compares the mean grey level of the darkest few images in a row with that of a dark one. The brighter half of an
    image counts: a black sky is no lack of light."""
    shots = [(shot.index, float(np.mean([_lit_level(i) for i in shot.images.values()]))) for shot in seen.shots]
    if len(shots) < IN_A_ROW:
        return None
    levels = np.array([mean for _, mean in shots])
    brightest = np.lib.stride_tricks.sliding_window_view(levels, IN_A_ROW).max(axis=1)
    level, dark = float(brightest.min()), np.flatnonzero(levels < DARK_LEVELS)
    where = f"{len(dark)} of {len(levels)} images are" if len(dark) else "no image is"
    return Finding(
        DARK_LEVELS / max(level, 1.0),
        f"The darkest images in a row have a grey level of {level:.0f} of 255; {where} dark (below {DARK_LEVELS:.0f}).",
        {"mean_grey": level, "dark_images": float(len(dark))},
        (shots[int(dark[0]) if len(dark) else int(levels.argmin())][0],),
    )


def _lit_level(image: Image) -> float:
    """Returns the mean grey level of the brighter half of the blocks."""
    means = np.sort(blocks(image)[0], axis=None)
    return float(means[len(means) // 2 :].mean()) if means.size else float(image.mean())


def edge_width_px(image: Image) -> float:
    """Returns the median width of the strongest edges [px], their step over their slope; inf where there are none."""
    smooth = cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)
    widths = []
    for grey in (smooth, np.ascontiguousarray(smooth.T)):
        slope = np.abs(grey[:, 2:] - grey[:, :-2]) / 2
        inner = slope[:, REACH_PX:-REACH_PX]
        if inner.size == 0:
            continue
        # one edge per tile, so that one long edge is not all of them
        tall, wide = inner.shape[0] // 10, inner.shape[1] // 10
        tiles = inner[: tall * 10, : wide * 10].reshape(tall, 10, wide, 10).transpose(0, 2, 1, 3).reshape(-1, 100)
        at, peak = tiles.argmax(axis=1), tiles.max(axis=1)
        order = np.argsort(-peak, kind="stable")[: EDGES // 2]
        rows, columns = (order // wide) * 10 + at[order] // 10, (order % wide) * 10 + at[order] % 10 + REACH_PX + 1
        for row, column, steep in zip(rows, columns, peak[order], strict=True):
            part = grey[row, column - REACH_PX : column + REACH_PX + 1]
            around = slope[
                row, column - 2 : column + 1
            ]  # a tile's steepest slope may belong to an edge of the next one
            if steep >= 3 and steep >= around.max():
                widths.append(float(part.max() - part.min()) / float(steep))
    return float(np.median(widths)) if len(widths) >= 20 else float("inf")


def blur(seen: Examination) -> Finding | None:
    """Measures how wide the strongest edges are in the blurriest few images in a row."""
    found: list[tuple[float, str, int, float]] = []
    for name in seen.rig.cameras:
        own = [shot for shot in seen.shots if name in shot.images]
        step = max(1, len(own) // BLUR_SAMPLES)
        widths = [(edge_width_px(shot.images[name]), shot.index) for shot in own[::step]]
        widths = [each for each in widths if np.isfinite(each[0])]
        row = max(2, -(-IN_A_ROW // step))
        if len(widths) >= row:
            spell = np.lib.stride_tricks.sliding_window_view([width for width, _ in widths], row).min(axis=1)
            first = int(spell.argmax())
            usual = float(np.median([width for width, _ in widths]))
            found.append((float(spell[first]), name, widths[first][1], usual))
    if not found:
        return None
    width, name, frame, usual = max(found)
    return Finding(
        width / EDGE_PX,
        f"The strongest edges of the blurriest {name} images in a row are {width:.1f} px wide, and usually {usual:.1f} "
        f"px (sharp: below {EDGE_PX:.1f}).",
        {"edge_width_px": width, "usual_edge_width_px": usual},
        (frame,),
    )


def haze(seen: Examination) -> Finding | None:
    """Compares the darkest with the brightest places of a camera's images. Haze before a lens or on it adds light
    everywhere: nothing is dark, and edges have less contrast, but stay sharp. None where there are no sharp edges, as
    on a bare wall or in blurred images."""
    found: list[tuple[float, str, int]] = []
    for name in seen.rig.cameras:
        own = [shot for shot in seen.shots if name in shot.images]
        ratios = [
            (_dark_over_bright(shot.images[name]), shot.index)
            for shot in own[:: max(1, len(own) // BLUR_SAMPLES)]
            if edge_width_px(shot.images[name]) < EDGE_PX and _lit_level(shot.images[name]) >= DARK_LEVELS
        ]
        if ratios:
            lasting = float(np.percentile([ratio for ratio, _ in ratios], 100 * (1 - HAZE_LASTS)))
            found.append((lasting, name, max(ratios)[1]))
    if not found:
        return None
    ratio, name, frame = max(found)
    return Finding(
        float(np.log(HAZE_RATIO) / np.log(min(ratio, 0.99))) if ratio > 0 else 0.0,
        f"The darkest places of the {name} images have {100 * ratio:.0f} % of the grey level of the brightest ones "
        f"(hazy from {100 * HAZE_RATIO:.0f} % on).",
        {"dark_over_bright": ratio},
        (frame,),
    )


def _dark_over_bright(image: Image) -> float:
    """Returns the grey level of the darkest places of an image over that of the brightest ones."""
    smooth = cv2.GaussianBlur(image, (0, 0), SENSOR_NOISE_PX)
    dark, bright = np.percentile(smooth, [100 * HAZE_SHARE, 100 * (1 - HAZE_SHARE)])
    return float(dark / max(bright, 1.0))


def low_texture(seen: Examination) -> Finding | None:
    """Measures the share of the main camera's image without texture."""
    shares, means = [], []
    for shot in seen.main_shots:
        mean, std = blocks(shot.images[seen.main])
        shares.append(float((std < BARE_STD).mean()))
        means.append(float(mean.mean()))
    if not shares or np.median(means) < DARK_LEVELS:
        return None
    share = float(np.median(shares))
    return Finding(
        share / BARE_SHARE,
        f"{100 * share:.0f} % of the image has no texture to follow (a cause from {100 * BARE_SHARE:.0f} % on).",
        {"bare_share": share},
        (seen.main_shots[int(np.argmax(shares))].index,),
    )


def exposure_jumps(seen: Examination) -> Finding | None:
    """Counts changes of the gain: the median ratio of the brightness around corners that are followed from a frame of
    the main camera to the next. Blocks at the same place of the image would show other parts of the scene.

    A gain changes all of them by the same ratio. If a quarter changes by less than half of it, it is no gain. None
    where too few corners are followed from any frame to the next.
    """
    uv, shots = seen.tracked.uv, seen.main_shots
    around = [cv2.blur(shot.images[seen.main], (AROUND_PX, AROUND_PX)).astype(np.float32) for shot in shots]
    jumps: list[tuple[float, int]] = []
    for f in range(1, len(shots)):
        both = np.isfinite(uv[:, f - 1, 0]) & np.isfinite(uv[:, f, 0])
        before, now = (_at(around[k], uv[both, k]) for k in (f - 1, f))
        usable = (before > 10) & (before < 240) & (now > 10) & (now < 240)
        if usable.sum() >= LEAST_CORNERS and both.sum() >= FOLLOWED * np.isfinite(uv[:, f - 1, 0]).sum():
            logs = np.log(now[usable] / before[usable])
            low, median, high = np.percentile(logs, [25, 50, 75])
            alike = max(low, -high) >= abs(median) / 2
            jumps.append((float(np.exp(abs(median))) if alike else 1.0, shots[f].index))
    if not jumps:
        return None
    high = [each for each in jumps if each[0] > GAIN]
    worst = max(jumps)
    strength = 1 + np.log(worst[0] / GAIN) * 4 if len(high) >= GAIN_JUMPS else np.log(worst[0]) / np.log(GAIN)
    return Finding(
        float(strength),
        f"The brightness of the same places changes by {100 * (worst[0] - 1):.0f} % from one frame to the next, "
        f"and {len(high)} times by more than {100 * (GAIN - 1):.0f} %.",
        {"largest_gain": worst[0], "jumps": float(len(high))},
        tuple(index for _, index in sorted(high, reverse=True)[:3]),
    )


def _at(image: Array, uv: Array) -> Array:
    """Returns the values (N,) of an image at the nearest pixels."""
    column, row = np.round(uv).astype(int).T
    return image[np.clip(row, 0, image.shape[0] - 1), np.clip(column, 0, image.shape[1] - 1)]


IMAGES = (
    Suspect(
        "darkness",
        "the images are too dark",
        "images",
        "Film with more light, a wider aperture or a longer exposure as far as motion blur allows it.",
        darkness,
    ),
    COVERED_LENS,
    Suspect(
        "blur",
        "the images are blurred",
        "images",
        "Focus the lens and clean it, and shorten the exposure. With images that exist: run them at half size "
        "(--video-scale 0.5).",
        blur,
    ),
    Suspect(
        "haze",
        "the images are hazy",
        "images",
        "Clean the lens, and keep the sun and lamps from shining onto it. In fog, smoke or dust, stay near to what is "
        "filmed.",
        haze,
    ),
    Suspect(
        "low-texture",
        "the scene has too little texture",
        "images",
        "Turn the camera to something with texture, use a wider lens, or add light from the side.",
        low_texture,
    ),
    Suspect(
        "exposure-jumps",
        "the exposure jumps",
        "images",
        "Fix exposure and gain while filming, or limit how fast the automatic exposure changes.",
        exposure_jumps,
    ),
)
