"""Suspects that tracks show: exchanged images, no parallax, motion too fast, and those of other files."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array

from ..examination import Examination
from ..finding import Finding, Suspect
from ..start import rotation_residuals
from .images import low_texture
from .lens import ON_LENS
from .level import UNLEVEL
from .moving import MOVING_OBJECTS
from .zoom import ZOOM

NEGATIVE_SHARE = 0.5
"""Share of the matches with a negative disparity from which on left and right are exchanged."""
LEAST_MATCHES = 30
PARALLAX_PX = 1.5
"""Median error of a pure rotation below which the depths of the scene cannot be seen."""
FAST_SHARE = 0.05
"""Motion from frame to frame, relative to the image's width, from which on it is too fast."""


def exchanged(seen: Examination) -> Finding | None:
    """Counts negative disparities: the left image shows a point farther to the right than the right image does."""
    if not seen.rig.has_stereo or not seen.pairs:
        return None
    disparity = (seen.tracked.left - seen.tracked.right)[..., 0]
    some = np.isfinite(disparity) & (np.abs(disparity) > 0.5)
    if some.sum() < LEAST_MATCHES:
        return None
    share = float((disparity[some] < 0).mean())
    return Finding(
        share / NEGATIVE_SHARE * (4 if share > NEGATIVE_SHARE else 1),
        f"{100 * share:.0f} % of {int(some.sum())} matches of the pair have a negative disparity; with left and right "
        f"exchanged, {100 * share:.0f} % are possible.",
        {"negative_share": share},
        (seen.pairs[0].index,),
    )


def motions_px(seen: Examination) -> Array:
    """Returns the median motion of the tracks from each frame to the next [px]."""
    moved = np.linalg.norm(np.diff(seen.tracked.uv, axis=1), axis=2)
    return np.array([np.nanmedian(column) for column in moved.T if np.isfinite(column).any()])


def no_parallax(seen: Examination) -> Finding | None:
    """Measures how well a pure rotation explains the tracks from one part of the stretch to another."""
    camera, uv = seen.rig.camera(seen.main), seen.tracked.uv
    best, farthest = None, 0.0
    count = uv.shape[1]
    for a in range(0, count, max(1, count // 6)):
        for b in range(a + 2, count, max(1, count // 8)):
            both = np.isfinite(uv[:, a, 0]) & np.isfinite(uv[:, b, 0])
            if both.sum() >= LEAST_MATCHES:
                residuals = rotation_residuals(camera.normalise(uv[both, a]), camera.normalise(uv[both, b]))
                best = max(best or 0.0, float(np.median(residuals)) * camera.fx)
                apart = np.linalg.norm(uv[both, a] - uv[both, b], axis=1)
                farthest = max(farthest, float(np.median(apart)))
    if best is None:
        return None
    what = "stands still" if farthest < PARALLAX_PX else "only rotates"
    return Finding(
        min(3.0, PARALLAX_PX / max(best, 1e-3)),
        f"A camera that {what} explains the tracks within {best:.2f} px (median), so they show no depths.",
        {"parallax_px": best, "moved_px": farthest},
        (seen.main_shots[0].index, seen.main_shots[-1].index),
    )


def too_fast(seen: Examination) -> Finding | None:
    """Compares the motion from frame to frame with the image's width; without texture the motion is unknown."""
    steps, bare = motions_px(seen), low_texture(seen)
    if not len(steps) or (bare is not None and bare.found):
        return None
    width = seen.rig.camera(seen.main).width
    fast = float(np.percentile(steps, 90)) / width
    lost = 1 - float(np.percentile(seen.tracked.survived, 10))
    return Finding(
        fast / FAST_SHARE,
        f"The scene moves by {100 * fast:.1f} % of the image's width from frame to frame, and up to {100 * lost:.0f} % "
        "of the corners are lost on the way.",
        {"motion_share": fast, "lost_share": lost},
        (seen.main_shots[int(np.argmax(steps)) + 1].index,),
    )


TRACKS = (
    Suspect(
        "exchanged",
        "the left and the right image are exchanged",
        "counterfactual",
        "Exchange the two folders or topics of the images, or the two cameras in the rig's file.",
        exchanged,
    ),
    UNLEVEL,
    ON_LENS,
    Suspect(
        "too-fast",
        "the camera moves too fast for its frame rate",
        "images",
        "Move or turn more slowly, film with more frames per second, or with a wider lens.",
        too_fast,
    ),
    Suspect(
        "no-parallax",
        "the camera does not change its place",
        "tracks",
        "Move sideways while turning: depths and a scale need a change of place. A pair sees depths without it.",
        no_parallax,
    ),
    MOVING_OBJECTS,
    ZOOM,
)
