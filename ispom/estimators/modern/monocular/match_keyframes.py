"""Matches a lost image with keyframes by descriptors, whose features are triangulated with neighbouring keyframes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.lens import Lens, corrected
from ispom.estimators.modern.monocular.align import align_patches
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.tracks import NewImage, nearest_speeds
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.modern.verification import Candidate, Verification, View, on_epipolar_lines
from ispom.features.interfaces import Features
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import InverseDepths, intersect
from ispom.solvers.multiview.rotation import rotate

FEATURE_ERROR = 3.0
"""Standard deviation of a described feature relative to that of a tracked point: about a pixel. The loss has this
width, too."""
MAX_OFF_LINE = 2.0
"""Largest distance from an epipolar line, between keyframes, in standard deviations of a feature."""
MIN_SIGNIFICANCE = 1.0
"""Least inverse depth of a feature, in its standard deviations: distant ones still constrain rotation."""
MIN_PATCH_SIGNIFICANCE = 1.5
"""The same for points triangulated from patches."""
MIN_INLIERS = 7
"""Least number of inliers of a pose; it predicts where to search the existing tracks."""
ENOUGH_INLIERS = 15
"""Number of inliers, sufficient for a pose, from which no further keyframe is compared."""
MIN_ALIGNED = 30
"""Number of aligned patches, sufficient for a pose (SURE), from which features without one are discarded: half of those
are wrong matches nearby, with errors of 4 to 14 px at the 90th percentile in sim:city, where aligned ones have 1 px."""
MAX_DESCRIBED = 5
"""Largest number of images described per frame, besides the new one and the last one: mostly those of two keyframes."""


@dataclass(frozen=True, eq=False)
class KeyframeMatch:
    """A frame matched with a keyframe."""

    views: tuple[tuple[Keyframe, Array], ...]
    """The keyframes with which its features were triangulated, and last the keyframe itself, each with the positions
    (N, 2) [px] of the features; NaN if not matched."""
    xyz: Array
    """(N, 3) points in the world."""
    uv: NDArray[np.float32]
    """(N, 2) [px] positions in the new image."""
    world_from_camera: Pose


def match_keyframes(
    setup: Setup,
    database: KeyframeDatabase,
    extra: Array,
    image: NewImage,
    now: Features,
    before: Keyframe | None,
    turn: int,
) -> tuple[KeyframeDatabase, KeyframeMatch | None]:
    """Matches the new image with the last localised one, `before`, if given, and with some keyframes, others at each
    `turn`.

    Returns the database with the new descriptions, and the match with the most points; None if no match is sufficient.
    `extra` (2,) is the lens correction, `now` are the features of the new image.
    """
    best, described = None, 0
    first = () if before is None else (before,)
    others = KeyframeDatabase(tuple(k for k in database.keyframes if k.time_ns not in {b.time_ns for b in first}))
    for keyframe in (*first, *others.query(image.grey, turn)):
        chosen = [*database.neighbours(keyframe), database.at(keyframe.time_ns) or keyframe]
        described += sum(not k.is_described(setup.front_end.descriptor) for k in chosen)
        if described > MAX_DESCRIBED:
            break
        chosen = [k.described(setup.front_end.descriptor) for k in chosen]
        for one in chosen:
            database = database.with_features(one)
        found = _match_keyframe(setup, extra, chosen, image, now)
        if found is not None and (best is None or len(found.uv) > len(best.uv)):
            best = found
            if len(best.uv) >= ENOUGH_INLIERS:
                break
    return database, best


def _match_keyframe(
    setup: Setup, extra: Array, keyframes: list[Keyframe], image: NewImage, now: Features
) -> KeyframeMatch | None:
    """Estimates the pose by resection from the last of the keyframes; None for too few points."""
    place, lens, sigma = keyframes[-1], Lens(setup.camera, extra), FEATURE_ERROR * setup.noise.sigma
    then = required(place.features, "the keyframe is not described")
    if len(keyframes) < 2:
        return None

    def observed(index: NDArray[np.int64]) -> list[Array]:
        return [_matched_positions(setup, extra, place, index, other, sigma) for other in keyframes]

    def xyz_of(index: NDArray[np.int64]) -> Array:
        return _triangulate(setup, extra, keyframes, observed(index), sigma)

    around_px = INLIER * FEATURE_ERROR * setup.noise_px.sigma
    verification = Verification(setup.front_end.matcher, INLIER * sigma, (around_px,), MIN_INLIERS, MIN_INLIERS)
    view = View(now, lambda index: lens.normalise(now.uv[index]), lens.in_image)
    found = verification.verify(Candidate(then, xyz_of, place.camera_from_world), view)
    if found is None:
        return None
    xyz, uv, seen = found.xyz, now.uv[found.pairs[:, 1]], observed(found.pairs[:, 0])
    seen = [_without_outliers(setup, extra, p, at, xyz, INLIER * sigma) for p, at in zip(keyframes, seen, strict=True)]
    views = [(p.camera_from_world, np.isfinite(at[:, 0])) for p, at in zip(keyframes, seen, strict=True)]
    views = [*views[:-1], (found.camera_from_world, np.ones(len(xyz), bool))]
    sure = depth_confirmed(xyz, place.camera_from_world, views, INLIER * sigma)
    if sure.sum() < MIN_INLIERS:
        return None
    if 2 * sure.sum() < len(sure):
        # Uncertain depths took over the map where they were the majority; a minority cannot.
        xyz, uv, seen = xyz[sure], uv[sure], [at[sure] for at in seen]
    back, near = place.camera_from_world @ found.camera_from_world.inverse(), found.camera_from_world.apply(xyz)
    aligned, good = align_patches(lens, place, seen[-1], back, near, image.grey, uv)
    uv = np.where(good[:, None], aligned, uv).astype(np.float32)
    if good.sum() >= MIN_ALIGNED:
        xyz, uv, seen = xyz[good], uv[good], [at[good] for at in seen]
    return KeyframeMatch(tuple(zip(keyframes, seen, strict=True)), xyz, uv, found.camera_from_world.inverse())


def depth_confirmed(
    xyz: Array, camera_from_world: Pose, others: list[tuple[Pose, NDArray[np.bool_]]], least: float
) -> NDArray[np.bool_]:
    """Checks which (N,) of the points (N, 3) that a camera observes have depths confirmed by two of the other views.

    `others`: camera_from_world, and which of the points (N,) agree with it. Anything on an epipolar line gives some
    depth, and near the first camera any depth agrees. So besides the view that gave the depth, another one must have a
    parallax of more than `least` (normalised). A point without such a parallax in any view counts as distant, whatever
    its depth.
    """
    near, shifts = camera_from_world.apply(xyz), list[Array]()
    for pose, agree in others:
        there, far = pose.apply(xyz), rotate(pose.rotation @ camera_from_world.rotation.T, near[:, :2] / near[:, 2:])
        shift = np.linalg.norm(there[:, :2] / there[:, 2:] - far, axis=1)
        shifts.append(np.where(agree, shift, 0.0))
    largest = np.sort(np.stack(shifts), axis=0)[::-1]
    return (largest[1] > least) | (largest[0] <= least)


def at_middle_row_of(setup: Setup, place: Keyframe, uv: Array) -> Array:
    """Returns pixels (N, 2) of a keyframe, moved to the time of the middle row; NaN stays NaN."""
    if place.moving is None:
        return uv
    at = uv.astype(np.float32)
    return uv - late_px(setup.camera, at, nearest_speeds(*place.moving, at))


def _matched_positions(
    setup: Setup, extra: Array, place: Keyframe, index: NDArray[np.int64], other: Keyframe, sigma: float
) -> Array:
    """Returns the positions (N, 2) [px], in another keyframe, of a keyframe's features, matched along their epipolar
    lines; NaN without a match."""
    here, there = (required(k.features, "the keyframe is not described") for k in (place, other))
    if other is place:
        return here.uv[index].astype(float)
    motion = other.camera_from_world @ place.camera_from_world.inverse()
    both = at_middle_row_of(setup, place, here.uv[index]), at_middle_row_of(setup, other, there.uv)
    x, y = (corrected(setup.camera.normalise(uv), extra) for uv in both)
    out = np.full((len(index), 2), np.nan)
    allowed = on_epipolar_lines(motion, x, y, MAX_OFF_LINE * sigma)
    pairs, _ = setup.front_end.matcher.match_where(here[index], there, allowed)
    out[pairs[:, 0]] = there.uv[pairs[:, 1]]
    return out


def _without_outliers(setup: Setup, extra: Array, place: Keyframe, uv: Array, xyz: Array, limit: float) -> Array:
    """Returns the positions `uv` (N, 2) [px] of points (N, 3) in a keyframe, NaN for outliers. `limit` normalised."""
    near = place.camera_from_world.apply(xyz)
    x = corrected(setup.camera.normalise(at_middle_row_of(setup, place, uv)), extra)
    off = x - near[:, :2] / np.maximum(near[:, 2:], 1e-9)
    return np.where((np.linalg.norm(off, axis=1) < limit)[:, None] & (near[:, 2:] > 0), uv, np.nan)


def _triangulate(setup: Setup, extra: Array, keyframes: list[Keyframe], seen: list[Array], sigma: float) -> Array:
    """Triangulates points (N, 3) in the world; NaN if uncertain. Uses all keyframes together or, as one may have a
    wrong match, the last one with a single other one: the most distant that agrees."""
    xyz, last = np.full((len(seen[0]), 3), np.nan), len(keyframes) - 1
    for others in (range(last), *([i] for i in range(last))):
        chosen = [*others, last]
        found = triangulate_features(
            setup, extra, [keyframes[i] for i in chosen], [seen[i] for i in chosen], Noise(sigma)
        )
        good = (found.depth > 0) & (found.worst < INLIER * sigma) & (found.significance > MIN_SIGNIFICANCE)
        good &= np.isnan(xyz[:, 0])
        xyz[good] = found.xyz_in_world[good]
    return xyz


def triangulate_features(
    setup: Setup, extra: Array, keyframes: list[Keyframe], seen: list[Array], noise: Noise
) -> InverseDepths:
    """Triangulates along the rays of the last keyframe, which has all the points."""
    stacked = np.stack([at_middle_row_of(setup, p, uv) for p, uv in zip(keyframes[::-1], seen[::-1], strict=True)])
    owners, cameras = np.nonzero(np.isfinite(stacked[:, :, 0]).T)
    poses = [p.camera_from_world for p in keyframes[::-1]]
    turns, ways = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    x = corrected(setup.camera.normalise(stacked[cameras, owners]), extra)
    return intersect(turns, ways, cameras, owners, x, stacked.shape[1], noise)


def retriangulate(setup: Setup, database: KeyframeDatabase, local_map: Map, match: KeyframeMatch) -> KeyframeMatch:
    """Triangulates the points (N, 3) of a match again from aligned patches, also in the window's other keyframes.

    A descriptor's position has an error of a pixel, and the two or three compared keyframes are close together,
    especially before a turn: such points constrained the pose after a gap less than tracks do. A point keeps its
    position if its patches do not agree with a static point, or if no other keyframe has them.
    """
    place, at = match.views[-1]
    others, window = {p.time_ns: (p, uv) for p, uv in match.views[:-1]}, {k.time_ns for k in local_map.keys}
    if window & {*others, place.time_ns}:
        nowhere = np.full_like(at, np.nan)
        others = {p.time_ns: (p, nowhere) for p in database.keyframes if p.time_ns in window - {place.time_ns}} | others
    views = [others[time_ns] for time_ns in sorted(others)]
    patches = [_find_patches(setup, local_map.extra, place, at, match.xyz, p) for p, _ in views]
    met = triangulate_features(setup, local_map.extra, [*(p for p, _ in views), place], [*patches, at], setup.noise)
    agree = (met.depth > 0) & (met.worst < INLIER * setup.noise.width) & (met.significance > MIN_PATCH_SIGNIFICANCE)
    agree &= np.isfinite(np.stack(patches)[:, :, 0]).any(axis=0)
    seen = [(p, np.where(agree[:, None], uv, old)) for (p, old), uv in zip(views, patches, strict=True)]
    return replace(match, views=(*seen, (place, at)), xyz=np.where(agree[:, None], met.xyz_in_world, match.xyz))


def _find_patches(setup: Setup, extra: Array, place: Keyframe, at: Array, xyz: Array, other: Keyframe) -> Array:
    """Returns the positions (N, 2) [px], in another keyframe, of a keyframe's patches `at` (N, 2) [px] of points (N,
    3); NaN without a match."""
    lens, near = Lens(setup.camera, extra), other.camera_from_world.apply(xyz)
    expected = lens.in_image(near)
    some = np.flatnonzero(np.isfinite(expected[:, 0]) & np.isfinite(at[:, 0]))
    expected, uv = expected[some], np.full_like(at, np.nan)
    if other.moving is not None:
        middle = expected.astype(np.float32)
        expected = expected + late_px(setup.camera, middle, nearest_speeds(*other.moving, middle))
    back = place.camera_from_world @ other.camera_from_world.inverse()
    found, good = align_patches(lens, place, at[some], back, near[some], other.images[0], expected, other.reduction)
    uv[some[good]] = found[good]
    return uv
