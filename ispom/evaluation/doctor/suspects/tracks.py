"""Suspects that tracks show: exchanged images, something on the lens, moving objects, no parallax, motion too fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose

from ..examination import Examination
from ..finding import Finding, Suspect
from ..start import rotation_residuals, triangulate

NEGATIVE_SHARE = 0.5
"""Share of the matches with a negative disparity from which on left and right are exchanged."""
LEAST_MATCHES = 30
BORDER = 0.08
"""Of the image's size: corners leave the image there."""
NEAR = 0.025
"""Places are the same within this, relative to the image's width."""
AGAIN, CHANCE = 1, 2.0
"""More other corners lost at a place than this, and so many times the usual share of those that were followed there,
make it one where corners are lost again and again."""
AGAIN_SHARE = 0.33
"""Of all lost corners, lost at such places."""
LOST_AGAIN_SHARE = 0.005
"""Of the corners of a frame, lost at such places."""
LEAST_FLOW_PX = 25.0
"""Way of the median track in the stretch from which on the scene is said to move through the image."""
MOVING_PX = 2.0
"""Median error of a track that no point at rest explains."""
RIGID_PX = 0.8
"""Median error of all tracks, so that those that move are an exception."""
MOVING_SHARE = 0.03
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


def on_lens(seen: Examination) -> Finding | None:
    """Counts corners that are lost again and again at the same places of the image, away from its border."""
    flow, camera, uv = way_px(seen), seen.rig.camera(seen.main), seen.tracked.uv
    if flow is None or flow < LEAST_FLOW_PX:
        return None
    known = np.isfinite(uv[..., 0])
    slow = motions_px(seen) < FAST_SHARE * camera.width  # where all moves fast, corners are lost for that
    if slow.sum() < 0.5 * len(slow) or len(slow) != known.shape[1] - 1:
        return None
    known = known & np.r_[slow, slow[-1]]
    lost = known[:, :-1] & ~np.isfinite(uv[:, 1:, 0])
    at = uv[:, :-1][lost]
    size = np.array([camera.width, camera.height])
    inside = ((at > BORDER * size) & (at < (1 - BORDER) * size)).all(axis=1)
    at = at[inside]
    share = len(at) / max(int(known[:, :-1].sum()), 1)
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    near_px = NEAR * camera.width
    everywhere = uv[:, :-1][known[:, :-1]]
    visits = (np.linalg.norm(at[:, None] - everywhere[None], axis=2) < near_px).sum(axis=1)
    again = float(((apart < near_px).sum(axis=1) - 1 > AGAIN + CHANCE * share * visits).mean()) if len(at) else 0.0
    return Finding(
        min(share * again / LOST_AGAIN_SHARE, again / AGAIN_SHARE),
        f"{100 * share:.1f} % of the corners are lost per frame away from the border, {100 * again:.0f} % of them "
        "where others were lost before.",
        {"lost_share": share, "again_share": again},
        (seen.main_shots[-1].index,),
    )


def way_px(seen: Examination) -> float | None:
    """Returns the way of the median track through the stretch, as the sum of the median motions of frames [px]."""
    steps = motions_px(seen)
    return float(steps.sum()) if len(steps) else None


def motions_px(seen: Examination) -> Array:
    """Returns the median motion of the tracks from each frame to the next [px]."""
    moved = np.linalg.norm(np.diff(seen.tracked.uv, axis=1), axis=2)
    return np.array([np.nanmedian(column) for column in moved.T if np.isfinite(column).any()])


def moving(seen: Examination) -> Finding | None:
    """Measures the share of the tracks that no point at rest explains, while most are explained."""
    if (found := track_errors_px(seen)) is None:
        return None
    errors, last = found
    typical = float(np.median(errors))
    away = errors > MOVING_PX
    together = clustered(last, away, 0.06 * seen.rig.camera(seen.main).width)
    share = float((away & together).mean())
    strength = share / MOVING_SHARE
    return Finding(
        strength if typical < RIGID_PX else min(strength, 0.9),
        f"{100 * share:.0f} % of the tracks form groups that move on their own: no point at rest explains them within "
        f"{MOVING_PX:.0f} px, while the median track fits within {typical:.2f} px.",
        {"moving_share": share, "median_px": typical},
        (seen.main_shots[len(seen.main_shots) // 2].index,),
    )


def track_errors_px(seen: Examination) -> tuple[Array, Array] | None:
    """Returns, of each track of some length in the main camera, the median error (N,) [px] of the point at rest that
    explains it best, and where it was seen last (N, 2); None where there is no rigid scene."""
    base, start = seen.baseline, seen.start
    if base is None or start is None:
        return None
    camera, scene = seen.rig.camera(seen.main), base.scene
    rig_from_camera = seen.rig.rig_from(seen.main)
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
    best = None
    count = uv.shape[1]
    for a in range(0, count, max(1, count // 6)):
        for b in range(a + 2, count, max(1, count // 8)):
            both = np.isfinite(uv[:, a, 0]) & np.isfinite(uv[:, b, 0])
            if both.sum() >= LEAST_MATCHES:
                residuals = rotation_residuals(camera.normalise(uv[both, a]), camera.normalise(uv[both, b]))
                best = max(best or 0.0, float(np.median(residuals)) * camera.fx)
    if best is None:
        return None
    way = way_px(seen) or 0.0
    what = "stands still" if way < PARALLAX_PX else "only rotates"
    return Finding(
        min(3.0, PARALLAX_PX / max(best, 1e-3)),
        f"A camera that {what} explains the tracks within {best:.2f} px (median), so they show no depths.",
        {"parallax_px": best, "way_px": way},
        (seen.main_shots[0].index, seen.main_shots[-1].index),
    )


def too_fast(seen: Examination) -> Finding | None:
    """Compares the motion from frame to frame with the image's width."""
    steps = motions_px(seen)
    if not len(steps):
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
    Suspect(
        "on-lens", "something is on the lens", "images", "Clean and dry the lens, or mask what stays in place.", on_lens
    ),
    Suspect(
        "too-fast",
        "the camera moves too fast for its frame rate",
        "tracks",
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
