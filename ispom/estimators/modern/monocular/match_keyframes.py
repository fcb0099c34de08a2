"""Matches a lost image with keyframes by descriptors, whose features are triangulated with neighbouring keyframes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimators.modern import trials
from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.lens import Lens
from ispom.estimators.modern.monocular.align import align_patches
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.tracks import NewImage, nearest_speeds
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.modern.trials import TrialKind, judged, trial
from ispom.estimators.modern.verification import Candidate, Verification, View, on_epipolar_lines
from ispom.features.interfaces import Features, Matcher
from ispom.geometry import Array, Pose, Similarity
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import InverseDepths, intersect
from ispom.solvers.multiview.rotation import rotate
from ispom.types import Camera

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
    index: NDArray[np.int64]
    """(N,) which of the features of the new image these are."""


def match_keyframes(
    setup: Setup,
    database: KeyframeDatabase,
    lens: Lens,
    image: NewImage,
    features: Features,
    last: Keyframe | None,
    turn: int,
    kind: TrialKind = "relocalisation",
) -> tuple[KeyframeDatabase, KeyframeMatch | None]:
    """Matches the new image with the `last` localised one, if given, and with some keyframes, others at each `turn`.

    Returns the database with the new descriptions, and the match with the most points; None if no match is sufficient.
    `features` are those of the new image.
    """
    best, described, descriptor = None, 0, setup.front_end.descriptor
    first = () if last is None else (last,)
    others = KeyframeDatabase(tuple(k for k in database.keyframes if k.time_ns not in {b.time_ns for b in first}))
    for keyframe in (*first, *others.query(image.grey, turn)):
        chosen = [*database.neighbours(keyframe), database.at(keyframe.time_ns) or keyframe]
        described += sum(not k.is_described(descriptor) for k in chosen)
        if described > MAX_DESCRIBED:
            break
        chosen = [k.described(descriptor) for k in chosen]
        for each in chosen:
            database = database.with_features(each)
        with trial(kind, "video", keyframe.time_ns, image.time_ns):
            match = _match_keyframe(setup, lens, chosen, image, features)
        if match is not None and (best is None or len(match.uv) > len(best.uv)):
            best = match
            if len(best.uv) >= ENOUGH_INLIERS:
                break
    return database, best


def _match_keyframe(
    setup: Setup, lens: Lens, keyframes: list[Keyframe], image: NewImage, features: Features
) -> KeyframeMatch | None:
    """Estimates the pose by resection from the last of the keyframes; None for too few points."""
    keyframe, matcher, sigma = keyframes[-1], setup.front_end.matcher, FEATURE_ERROR * setup.noise.sigma
    keyframe_features = required(keyframe.features, "the keyframe is not described")
    if len(keyframes) < 2:
        return None

    def positions(index: NDArray[np.int64]) -> list[Array]:
        return [_matched_positions(matcher, lens, keyframe, index, other, sigma) for other in keyframes]

    def xyz_of(index: NDArray[np.int64]) -> Array:
        return _triangulate(lens, keyframes, positions(index), sigma)

    around_px = INLIER * FEATURE_ERROR * setup.noise_px.sigma
    verification = Verification(matcher, INLIER * sigma, (around_px,), MIN_INLIERS, MIN_INLIERS)
    view = View(features, lambda index: lens.normalise(features.uv[index]), lens.in_image)
    verified = verification.verify(Candidate(keyframe_features, xyz_of, keyframe.camera_from_world), view)
    if trials.is_collecting():
        trials.report_positions(lens.normalise(keyframe_features.uv), lens.normalise(features.uv))
    if verified is None:
        return None
    xyz, index, pose = verified.xyz, verified.pairs[:, 1], verified.camera_from_world
    uv = features.uv[index]
    matched = zip(keyframes, positions(verified.pairs[:, 0]), strict=True)
    observed = [_without_outliers(lens, k, at, xyz, INLIER * sigma) for k, at in matched]
    views = [(k.camera_from_world, np.isfinite(at[:, 0])) for k, at in zip(keyframes, observed, strict=True)]
    views = [*views[:-1], (pose, np.ones(len(xyz), bool))]
    confirmed = depth_confirmed(xyz, keyframe.camera_from_world, views, INLIER * sigma)
    if not judged(confirmed.sum() >= MIN_INLIERS, trials.DEPTHS, confirmed.sum(), MIN_INLIERS):
        return None
    near = keyframe.camera_from_world.apply(xyz)[:, 2]
    trials.report_pose(Similarity(1.0, keyframe.camera_from_world @ pose.inverse()), None, float(np.median(near)))
    if 2 * confirmed.sum() < len(confirmed):
        # Uncertain depths took over the map where they were the majority; a minority cannot.
        xyz, uv, index, observed = xyz[confirmed], uv[confirmed], index[confirmed], [at[confirmed] for at in observed]
    keyframe_from_camera = keyframe.camera_from_world @ pose.inverse()
    aligned, good = align_patches(lens, keyframe, observed[-1], keyframe_from_camera, pose.apply(xyz), image.grey, uv)
    uv = np.where(good[:, None], aligned, uv).astype(np.float32)
    if good.sum() >= MIN_ALIGNED:
        xyz, uv, index, observed = xyz[good], uv[good], index[good], [at[good] for at in observed]
    return KeyframeMatch(tuple(zip(keyframes, observed, strict=True)), xyz, uv, pose.inverse(), index)


def triangulate_with_neighbours(
    setup: Setup, database: KeyframeDatabase, lens: Lens, keyframe: Keyframe, index: NDArray[np.int64]
) -> tuple[KeyframeDatabase, Array]:
    """Triangulates features `index` (N,) of a described keyframe with its neighbours: (N, 3) in the world of its
    segment; NaN if uncertain. Also returns the database with the new descriptions."""
    sigma, matcher = FEATURE_ERROR * setup.noise.sigma, setup.front_end.matcher
    views = [*(k.described(setup.front_end.descriptor) for k in database.neighbours(keyframe)), keyframe]
    for each in views:
        database = database.with_features(each)
    if len(views) < 2:
        return database, np.full((len(index), 3), np.nan)
    observed = [_matched_positions(matcher, lens, keyframe, index, other, sigma) for other in views]
    return database, _triangulate(lens, views, observed, sigma)


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


def at_middle_row_of(camera: Camera, keyframe: Keyframe, uv: Array) -> Array:
    """Returns pixels (N, 2) of a keyframe, moved to the time of the middle row; NaN stays NaN."""
    if keyframe.moving is None:
        return uv
    at = uv.astype(np.float32)
    return uv - late_px(camera, at, nearest_speeds(*keyframe.moving, at))


def _matched_positions(
    matcher: Matcher, lens: Lens, keyframe: Keyframe, index: NDArray[np.int64], other: Keyframe, sigma: float
) -> Array:
    """Returns the positions (N, 2) [px], in another keyframe, of a keyframe's features, matched along their epipolar
    lines; NaN without a match."""
    here, there = (required(k.features, "the keyframe is not described") for k in (keyframe, other))
    if other is keyframe:
        return here.uv[index].astype(float)
    other_from_keyframe = other.camera_from_world @ keyframe.camera_from_world.inverse()
    x = lens.normalise(at_middle_row_of(lens.camera, keyframe, here.uv[index]))
    y = lens.normalise(at_middle_row_of(lens.camera, other, there.uv))
    out = np.full((len(index), 2), np.nan)
    allowed = on_epipolar_lines(other_from_keyframe, x, y, MAX_OFF_LINE * sigma)
    pairs, _ = matcher.match_where(here[index], there, allowed)
    out[pairs[:, 0]] = there.uv[pairs[:, 1]]
    return out


def _without_outliers(lens: Lens, keyframe: Keyframe, uv: Array, xyz: Array, limit: float) -> Array:
    """Returns the positions `uv` (N, 2) [px] of points (N, 3) in a keyframe, NaN for outliers. `limit` normalised."""
    in_camera = keyframe.camera_from_world.apply(xyz)
    errors = lens.normalise(at_middle_row_of(lens.camera, keyframe, uv))
    errors = errors - in_camera[:, :2] / np.maximum(in_camera[:, 2:], 1e-9)
    return np.where((np.linalg.norm(errors, axis=1) < limit)[:, None] & (in_camera[:, 2:] > 0), uv, np.nan)


def _triangulate(lens: Lens, keyframes: list[Keyframe], observed: list[Array], sigma: float) -> Array:
    """Triangulates points (N, 3) in the world; NaN if uncertain. Uses all keyframes together or, as one may have a
    wrong match, the last one with a single other one: the most distant that agrees."""
    xyz, last = np.full((len(observed[0]), 3), np.nan), len(keyframes) - 1
    for others in (range(last), *([i] for i in range(last))):
        chosen = [*others, last]
        points = triangulate_features(lens, [keyframes[i] for i in chosen], [observed[i] for i in chosen], Noise(sigma))
        good = (points.depth > 0) & (points.worst < INLIER * sigma) & (points.significance > MIN_SIGNIFICANCE)
        good &= np.isnan(xyz[:, 0])
        xyz[good] = points.xyz_in_world[good]
    return xyz


def triangulate_features(lens: Lens, keyframes: list[Keyframe], observed: list[Array], noise: Noise) -> InverseDepths:
    """Triangulates along the rays of the last keyframe, which has all the points; `observed` (N, 2) [px] in each."""
    pairs = zip(keyframes[::-1], observed[::-1], strict=True)
    uv = np.stack([at_middle_row_of(lens.camera, k, at) for k, at in pairs])
    owners, cameras = np.nonzero(np.isfinite(uv[:, :, 0]).T)
    poses = [k.camera_from_world for k in keyframes[::-1]]
    rotations, translations = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    x = lens.normalise(uv[cameras, owners])
    return intersect(rotations, translations, cameras, owners, x, uv.shape[1], noise)


def retriangulate(setup: Setup, database: KeyframeDatabase, local_map: Map, match: KeyframeMatch) -> KeyframeMatch:
    """Triangulates the points (N, 3) of a match again from aligned patches, also in the window's other keyframes.

    A descriptor's position has an error of a pixel, and the two or three compared keyframes are close together,
    especially before a turn: such points constrained the pose after a gap less than tracks do. A point keeps its
    position if its patches do not agree with a static point, or if no other keyframe has them.
    """
    lens, width, (keyframe, at) = Lens(setup.camera, local_map.extra), setup.noise.width, match.views[-1]
    others, window = {k.time_ns: (k, uv) for k, uv in match.views[:-1]}, {k.time_ns for k in local_map.keys}
    if window & {*others, keyframe.time_ns}:
        nowhere = np.full_like(at, np.nan)
        missing = window - {keyframe.time_ns}
        others = {k.time_ns: (k, nowhere) for k in database.keyframes if k.time_ns in missing} | others
    views = [others[time_ns] for time_ns in sorted(others)]
    patches = [_find_patches(lens, keyframe, at, match.xyz, k) for k, _ in views]
    points = triangulate_features(lens, [*(k for k, _ in views), keyframe], [*patches, at], setup.noise)
    agree = (points.depth > 0) & (points.worst < INLIER * width) & (points.significance > MIN_PATCH_SIGNIFICANCE)
    agree &= np.isfinite(np.stack(patches)[:, :, 0]).any(axis=0)
    views = [(k, np.where(agree[:, None], uv, old)) for (k, old), uv in zip(views, patches, strict=True)]
    xyz = np.where(agree[:, None], points.xyz_in_world, match.xyz)
    return replace(match, views=(*views, (keyframe, at)), xyz=xyz)


def _find_patches(lens: Lens, keyframe: Keyframe, at: Array, xyz: Array, other: Keyframe) -> Array:
    """Returns the positions (N, 2) [px], in another keyframe, of a keyframe's patches `at` (N, 2) [px] of points (N,
    3); NaN without a match."""
    in_other = other.camera_from_world.apply(xyz)
    expected = lens.in_image(in_other)
    some = np.flatnonzero(np.isfinite(expected[:, 0]) & np.isfinite(at[:, 0]))
    expected, uv = expected[some], np.full_like(at, np.nan)
    if other.moving is not None:
        middle = expected.astype(np.float32)
        expected = expected + late_px(lens.camera, middle, nearest_speeds(*other.moving, middle))
    keyframe_from_other = keyframe.camera_from_world @ other.camera_from_world.inverse()
    aligned, good = align_patches(
        lens, keyframe, at[some], keyframe_from_other, in_other[some], other.images[0], expected, other.reduction
    )
    uv[some[good]] = aligned[good]
    return uv
