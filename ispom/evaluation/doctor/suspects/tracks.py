"""Suspects that tracks show: exchanged images, moving objects, no parallax, motion too fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Rig

from ..counterfactual import Baseline, baseline, tested
from ..examination import Examination
from ..finding import Finding, Suspect
from ..start import rotation_residuals, triangulate
from .images import low_texture
from .lens import ON_LENS
from .level import UNLEVEL

NEGATIVE_SHARE = 0.5
"""Share of the matches with a negative disparity from which on left and right are exchanged."""
LEAST_MATCHES = 30
MOVING_PX = 2.0
"""Median error of a track that no point at rest explains."""
RIGID_PX = MOVING_PX / 2
"""Three quarters of the other tracks have a smaller error, so that those that move are an exception: where the scene
itself fits badly, as with a rolling shutter in a fast turn, groups of tracks are off, too."""
MOVING_SHARE = 0.03
"""Of the tracks, in such groups: 4 to 8 % with traffic in a simulated street, 0 % without (seeds 0 to 3)."""
OF_THE_LENS = 0.3
"""Share of these tracks that a changed lens explains as points at rest, from which on it is not known what they are:
in a simulated street with traffic it explains none (seeds 0 to 2)."""
LENSES = {
    "video": (("k1",), ("video_focal_percent",), ("video_centre_x_px", "video_centre_y_px")),
    "left": (("k1",), ("pair_focal_percent",), ("pair_centre_x_px", "pair_centre_y_px")),
}
"""Numbers of the lens that are freed, by the main camera."""
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


def moving(seen: Examination) -> Finding | None:
    """Measures the share of the tracks that no point at rest explains, while most are explained. None where a changed
    lens explains many of them as points at rest: at the border of an image with a wrong lens, all tracks are off."""
    base = seen.baseline
    if base is None or (found := track_errors_px(seen, base, seen.rig)) is None:
        return None
    errors, last = found
    away = errors > MOVING_PX
    group = away & clustered(last, away, 0.06 * seen.rig.camera(seen.main).width)
    share, typical = float(group.mean()), float(np.percentile(errors[~group], 75)) if not group.all() else np.inf
    strength = share / MOVING_SHARE
    if strength >= 1 and typical < RIGID_PX and _of_the_lens(seen, base, group):
        return None
    return Finding(
        strength if typical < RIGID_PX else min(strength, 0.9),
        f"{100 * share:.0f} % of the tracks form groups that move on their own: no point at rest explains them within "
        f"{MOVING_PX:.0f} px, while three quarters of the others fit within {typical:.2f} px.",
        {"moving_share": share, "others_px": typical},
        (seen.main_shots[len(seen.main_shots) // 2].index,),
    )


def _of_the_lens(seen: Examination, base: Baseline, group: NDArray[np.bool_]) -> bool:
    """Checks whether a changed lens explains many of these tracks (N,) as points at rest."""
    for names in LENSES[seen.main]:
        rig = tested(base, names).change.of_rig(seen.rig)
        found = None if seen.start is None else track_errors_px(seen, baseline(seen.start, rig), rig)
        if found is not None and float((found[0][group] < MOVING_PX).mean()) > OF_THE_LENS:
            return True
    return False


def track_errors_px(seen: Examination, base: Baseline, rig: Rig) -> tuple[Array, Array] | None:
    """Returns, of each track of some length in the main camera, the median error (N,) [px] of the point at rest that
    explains it best, and where it was seen last (N, 2), in a scene with its rig; None where there are few tracks."""
    if (start := seen.start) is None:
        return None
    camera, scene = rig.camera(seen.main), base.scene
    rig_from_camera = rig.rig_from(seen.main)
    poses = [Pose(r, t) @ rig_from_camera for r, t in zip(scene.rotations, scene.positions, strict=True)]
    uv = seen.tracked.uv[:, start.knots]
    uv = uv[np.isfinite(uv[..., 0]).sum(axis=1) >= 4]
    if len(uv) < LEAST_MATCHES:
        return None
    rays = camera.normalise(uv.reshape(-1, 2)).reshape(uv.shape)
    _, errors = triangulate(rays, dict(enumerate(poses)))
    last = np.array([track[np.isfinite(track[:, 0])][-1] for track in uv])
    return np.minimum(np.nan_to_num(errors, nan=1.0), 1.0) * camera.fx, last


def clustered(uv: Array, chosen: NDArray[np.bool_], radius_px: float) -> NDArray[np.bool_]:
    """Checks which positions (N, 2) have at least two of the chosen ones near, and more of these than of the others."""
    apart = np.linalg.norm(uv[:, None] - uv[None], axis=2)
    near = (apart < radius_px) & ~np.eye(len(uv), dtype=bool)
    of_chosen = near[:, chosen].sum(axis=1)
    return (of_chosen >= 2) & (of_chosen >= near[:, ~chosen].sum(axis=1))


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
    Suspect(
        "moving-objects",
        "moving objects fill a part of the image",
        "tracks",
        "Mask what moves, wait until it has passed, or aim at what is at rest.",
        moving,
    ),
)
