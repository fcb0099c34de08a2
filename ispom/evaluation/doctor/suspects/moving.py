"""Moving objects: groups of tracks that no point at rest explains, while most tracks are explained.

There are two tests, and the stronger one counts. The first uses the rigid scene, which shows depth and motion together,
such as a vehicle that drives along the road. But the scene is fitted to all tracks, and a large object bends it. The
second uses the relative pose of two views, which most tracks determine, whatever the others do: moving points are not
on their epipolar lines. If the camera does not change its position, a rotation replaces the relative pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.essential import relative_pose, sampson_distance
from ispom.types import Camera, Rig

from ..counterfactual import baseline
from ..examination import Examination
from ..finding import Finding, Suspect
from ..start import rotation_residuals, triangulate

LEAST_TRACKS = 30
MOVING_PX = 2.0
"""Median error of a track that no point of the scene explains."""
VIEWS_PX = (MOVING_PX, 2 * MOVING_PX)
"""The same for two views; the larger one is for a fast camera, where most tracks fit less well."""
RIGID = 0.5
"""Three quarters of the other tracks must have an error below this part of the limit. Where the scene itself fits
badly, as with a rolling shutter in a fast turn, groups of tracks have large errors, too."""
MOVING_SHARE = 0.03
"""Least share of the tracks in such groups: 4 to 8 % with traffic in a simulated street, 0 % without (seeds 0 to 3)."""
OF_THE_LENS = 0.3
"""Share of these tracks that a changed lens explains as static points, from which on they may be static: in a simulated
street with traffic it explains none (seeds 0 to 2)."""
MOST_SHARE = 0.6
"""Largest share of tracks on moving objects; a larger one is not an object before a scene."""
LENSES = {
    "video": (("k1",), ("video_focal_percent",), ("video_centre_x_px", "video_centre_y_px"), ("aspect_percent",)),
    "left": (("k1",), ("pair_focal_percent",), ("pair_centre_x_px", "pair_centre_y_px"), ("aspect_percent",)),
}
"""Numbers of the lens that are freed, by the main camera."""
NEAR = 0.06
"""Radius of a group, relative to the image's width."""
PARTS = (4, 6, 9)
"""The interval between two views is the length of the stretch divided by each of these numbers: long enough for a
motion, short enough for the same tracks in both views."""
VIEWS = 12
"""Pairs of views, at most."""
LEAST_EVEN = 15
"""Least number of tracks in different places of the image from which the motion of two views is known."""
LEAST_VIEWS = 2
"""Least number of views in which a track must be observed to count."""
INLIER_PX = 0.5
"""Largest distance of a static point from its epipolar line, in the search for the motion of two views."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of N tracks as static points."""

    px: Array
    """(N,) median of the track."""
    last: Array
    """(N, 2) where it was seen last."""
    track: NDArray[np.int64]
    """(N,) its number."""


Measure = Callable[[Rig], "Errors | None"]
"""Returns the errors for a rig, whose lens may be changed; None with few tracks."""


def moving(seen: Examination) -> Finding | None:
    """Measures the share of the tracks that no static point explains, while most tracks are explained. None where a
    changed lens explains many of them as static: at the border of an image with a wrong lens, all tracks have large
    errors."""
    measures: list[tuple[Measure, tuple[float, ...]]] = [(partial(scene_errors, seen), (MOVING_PX,))]
    measures += [(partial(view_errors, seen, part, even), VIEWS_PX) for part in PARTS for even in (False, True)]
    tried: list[tuple[Finding, Measure, NDArray[np.int64], float]] = []
    for measure, limits_px in measures:
        if (errors := measure(seen.rig)) is not None:
            for limit_px in limits_px:
                group = grouped(seen, errors, limit_px)
                tried.append((_judged(seen, errors, group, limit_px), measure, errors.track[group], limit_px))
    if not tried:
        return None
    finding, measure, group, limit_px = max(tried, key=lambda each: each[0].strength)
    return None if finding.found and _of_the_lens(seen, measure, group, limit_px) else finding


def grouped(seen: Examination, errors: Errors, limit_px: float) -> NDArray[np.bool_]:
    """Returns which tracks (N,) have a larger error than `limit_px`, and are in groups."""
    away = errors.px > limit_px
    return away & clustered(errors.last, away, NEAR * seen.rig.camera(seen.main).width)


def _judged(seen: Examination, errors: Errors, group: NDArray[np.bool_], limit_px: float) -> Finding:
    share = float(group.mean())
    typical = typical_px(errors, group)
    strength = share / MOVING_SHARE
    return Finding(
        strength if typical < limit_px * RIGID and share < MOST_SHARE else min(strength, 0.9),
        f"{100 * share:.0f} % of the tracks form groups that move on their own: no point at rest explains them within "
        f"{limit_px:.0f} px, while three quarters of the others fit within {typical:.2f} px.",
        {"moving_share": share, "others_px": typical},
        (seen.main_shots[len(seen.main_shots) // 2].index,),
    )


def _of_the_lens(seen: Examination, measure: Measure, group: NDArray[np.int64], limit_px: float) -> bool:
    """Checks whether a changed lens explains many of these tracks as well as others at rest, and these no worse than
    before."""
    if seen.baseline is None or (stated := measure(seen.rig)) is None:
        return False
    typical = typical_px(stated, np.isin(stated.track, group))
    for names in LENSES[seen.main]:
        errors = measure(seen.freed(names).of_rig(seen.rig))
        mine = np.zeros(0, bool) if errors is None else np.isin(errors.track, group)
        if errors is None or not mine.any() or typical_px(errors, mine) > typical:
            continue
        if float((errors.px[mine] < RIGID * limit_px).mean()) > OF_THE_LENS:
            return True
    return False


def typical_px(errors: Errors, group: NDArray[np.bool_]) -> float:
    """Returns the error below which three quarters of the tracks are that are not in the group (N,)."""
    return float(np.percentile(errors.px[~group], 75)) if not group.all() else np.inf


def scene_errors(seen: Examination, rig: Rig) -> Errors | None:
    """Returns the distances of tracks from the points of the scene that explain them best."""
    if (start := seen.start) is None or seen.baseline is None:
        return None
    scene = (seen.baseline if rig is seen.rig else baseline(start, rig)).scene
    camera, rig_from_camera = rig.camera(seen.main), rig.rig_from(seen.main)
    poses = [Pose(r, t) @ rig_from_camera for r, t in zip(scene.rotations, scene.positions, strict=True)]
    uv = seen.tracked.uv[:, start.knots]
    long = np.flatnonzero(np.isfinite(uv[..., 0]).sum(axis=1) >= 4)
    if len(long) < LEAST_TRACKS:
        return None
    _, errors = triangulate(_normalised(camera, uv[long]), dict(enumerate(poses)))
    return Errors(np.minimum(np.nan_to_num(errors, nan=1.0), 1.0) * camera.fx, _last(uv[long]), long)


def view_errors(seen: Examination, part: int, even: bool, rig: Rig) -> Errors | None:
    """Returns the distances of tracks from their epipolar lines in several pairs of views, whose interval is the length
    of the stretch divided by `part`. If there is no scene, because the camera does not change its position, they are
    distances from the prediction of a rotation. The motion of the views is that of most tracks, or of most places
    (`even`)."""
    camera, uv = rig.camera(seen.main), seen.tracked.uv
    rays, frames = _normalised(camera, uv), uv.shape[1]
    apart = max(2, frames // part)
    first = range(0, frames - apart, max(1, (frames - apart) // VIEWS))
    errors = np.full((len(uv), len(first)), np.nan)
    for k, a in enumerate(first):
        both = np.isfinite(rays[:, [a, a + apart], 0]).all(axis=1)
        if both.sum() >= LEAST_TRACKS:
            chosen = _even(uv[both, a], NEAR * camera.width) if even else np.arange(both.sum())
            errors[both, k] = _two_views(rays[both, a], rays[both, a + apart], chosen, camera.fx, seen.start is None)
    often = np.flatnonzero(np.isfinite(errors).sum(axis=1) >= LEAST_VIEWS)
    if len(often) < LEAST_TRACKS:
        return None
    return Errors(np.nanmedian(errors[often], axis=1) * camera.fx, _last(uv[often]), often)


def _even(uv: Array, side_px: float) -> NDArray[np.int64]:
    """Returns the numbers of positions (N, 2), one for each square of the image that has any: an object with many
    corners is no larger for it."""
    return np.sort(np.unique((uv / side_px).astype(int), axis=0, return_index=True)[1])


def _two_views(a: Array, b: Array, chosen: NDArray[np.int64], focal_px: float, only_turned: bool) -> Array:
    """Returns the distances (N,) of normalised coordinates (N, 2) from the prediction by the motion of most of the
    chosen ones; NaN where there is none."""
    if only_turned:
        return rotation_residuals(a, b)
    if len(chosen) < LEAST_EVEN:
        return np.full(len(a), np.nan)
    most = relative_pose(a[chosen], b[chosen], INLIER_PX / focal_px)
    return np.full(len(a), np.nan) if most is None else np.abs(sampson_distance(most.second_from_first, a, b))


def _normalised(camera: Camera, uv: Array) -> Array:
    return camera.normalise(uv.reshape(-1, 2)).reshape(uv.shape)


def _last(uv: Array) -> Array:
    """Returns where tracks (N, F, 2) were seen last (N, 2)."""
    return np.array([track[np.isfinite(track[:, 0])][-1] for track in uv])


def clustered(uv: Array, chosen: NDArray[np.bool_], radius_px: float) -> NDArray[np.bool_]:
    """Checks which positions (N, 2) have at least two of the chosen ones near, and more of these than of the others."""
    apart = np.linalg.norm(uv[:, None] - uv[None], axis=2)
    near = (apart < radius_px) & ~np.eye(len(uv), dtype=bool)
    of_chosen = near[:, chosen].sum(axis=1)
    return (of_chosen >= 2) & (of_chosen >= near[:, ~chosen].sum(axis=1))


MOVING_OBJECTS = Suspect(
    "moving-objects",
    "moving objects fill a part of the image",
    "tracks",
    "Mask what moves, wait until it has passed, or aim at what is at rest.",
    moving,
)
