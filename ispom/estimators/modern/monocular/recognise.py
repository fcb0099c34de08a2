"""What a key frame saw and an image shows as well: by descriptors, intersected between the key frames around it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.keyframe_database import Keyframe, KeyframeDatabase
from ispom.estimators.modern.lens import Lens, corrected
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.realign import patches_found
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.state import NewImage
from ispom.estimators.modern.monocular.tracks import nearest_speed
from ispom.estimators.modern.rolling import late_px
from ispom.estimators.modern.verification import Candidate, Verification, View, on_epipolar_lines
from ispom.features.interfaces import Features
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import InverseDepths, intersect
from ispom.solvers.multiview.rotation import rotate

FEATURE_ERROR = 3.0
"""Standard deviation of a described feature over that of a tracked point: about a pixel. It is the width of the loss,
too."""
MAX_OFF = 2.0
"""Deviations from an epipolar line, between key frames, beyond which a feature is another one."""
MIN_SIGNIFICANCE = 1.0
"""A feature's inverse depth exceeds so many standard deviations of it: far ones still say how the camera is turned."""
MIN_PATCH_SIGNIFICANCE = 1.5
"""The same of points triangulated from patches."""
FEWEST = 7
"""Points that agree with a pose, from which the tracks that there were are looked for where it puts them."""
ENOUGH = 15
"""With so many, as a pose needs, no further key frame is compared."""
ALIGNED = 30
"""With so many whose patches look alike, enough for a pose (SURE), others take no part: half of these are other things
that happen to lie near, 4 to 14 px off at the 90th percentile in sim:city where those are 1 px off."""
MOST_DESCRIBED = 5
"""Images described at one exposure, the new one and the last one aside: those of two key frames, mostly."""


@dataclass(frozen=True, eq=False)
class Recognised:
    """A frame that shows what a key frame saw."""

    views: tuple[tuple[Keyframe, Array], ...]
    """The key frame, last, and those before it with which its features were intersected: where (N, 2) each has them
    [px], NaN where not."""
    xyz: Array
    """(N, 3) in the world."""
    uv: NDArray[np.float32]
    """(N, 2) [px] where the new image has them."""
    world_from_camera: Pose


def recognised(
    setup: Setup,
    database: KeyframeDatabase,
    extra: Array,
    new: NewImage,
    now: Features,
    before: Keyframe | None,
    turn: int,
) -> tuple[KeyframeDatabase, Recognised | None]:
    """The image that shows most of what the new one shows, if that is enough; and the database with what was described.

    Of the last one located, `before`, if there is one, and some keyframes, at each `turn` others. `extra` (2,) is the
    lens's correction, `now` are the features of the new image.
    """
    best, described = None, 0
    first = () if before is None else (before,)
    others = KeyframeDatabase(tuple(k for k in database.keyframes if k.time_ns not in {b.time_ns for b in first}))
    for keyframe in (*first, *others.query(new.grey, turn)):
        chosen = [*database.neighbours(keyframe), database.at(keyframe.time_ns) or keyframe]
        described += sum(not k.is_described(setup.front_end.descriptor) for k in chosen)
        if described > MOST_DESCRIBED:
            break
        chosen = [k.described(setup.front_end.descriptor) for k in chosen]
        for one in chosen:
            database = database.with_features(one)
        found = _compared(setup, extra, chosen, new, now)
        if found is not None and (best is None or len(found.uv) > len(best.uv)):
            best = found
            if len(best.uv) >= ENOUGH:
                break
    return database, best


def _compared(setup: Setup, extra: Array, keyframes: list[Keyframe], new: NewImage, now: Features) -> Recognised | None:
    """The pose by resection from what the last of the keyframes and the image show; None for too few points."""
    place, lens, sigma = keyframes[-1], Lens(setup.camera, extra), FEATURE_ERROR * setup.noise.sigma
    then = place.features
    assert then is not None
    if len(keyframes) < 2:
        return None

    def observed(index: NDArray[np.int64]) -> list[Array]:
        return [_seen(setup, extra, place, index, other, sigma) for other in keyframes]

    def xyz_of(index: NDArray[np.int64]) -> Array:
        return _intersected(setup, extra, keyframes, observed(index), sigma)

    around_px = INLIER * FEATURE_ERROR * setup.noise_px.sigma
    verification = Verification(setup.front_end.matcher, INLIER * sigma, (around_px,), FEWEST, FEWEST)
    view = View(now, lambda index: lens.normalise(now.uv[index]), lens.in_image)
    found = verification.verify(Candidate(then, xyz_of, place.camera_from_world), view)
    if found is None:
        return None
    xyz, uv, seen = found.xyz, now.uv[found.pairs[:, 1]], observed(found.pairs[:, 0])
    seen = [_agreeing(setup, extra, p, at, xyz, INLIER * sigma) for p, at in zip(keyframes, seen, strict=True)]
    views = [(p.camera_from_world, np.isfinite(at[:, 0])) for p, at in zip(keyframes, seen, strict=True)]
    views = [*views[:-1], (found.camera_from_world, np.ones(len(xyz), bool))]
    sure = depth_confirmed(xyz, place.camera_from_world, views, INLIER * sigma)
    if sure.sum() < FEWEST:
        return None
    if 2 * sure.sum() < len(sure):
        # The lesser part of them cannot take over the map; the greater part did.
        xyz, uv, seen = xyz[sure], uv[sure], [at[sure] for at in seen]
    back, near = place.camera_from_world @ found.camera_from_world.inverse(), found.camera_from_world.apply(xyz)
    aligned, good = patches_found(lens, place, seen[-1], back, near, new.grey, uv)
    uv = np.where(good[:, None], aligned, uv).astype(np.float32)
    if good.sum() >= ALIGNED:
        xyz, uv, seen = xyz[good], uv[good], [at[good] for at in seen]
    return Recognised(tuple(zip(keyframes, seen, strict=True)), xyz, uv, found.camera_from_world.inverse())


def depth_confirmed(
    xyz: Array, camera_from_world: Pose, others: list[tuple[Pose, NDArray[np.bool_]]], least: float
) -> NDArray[np.bool_]:
    """Which (N,) of the points (N, 3) that a camera sees have depths that two of the other views speak for.

    `others`: camera_from_world, and which of the points (N,) agree with it. Whatever lies on an epipolar line gives
    some depth, and from near the first camera any depth agrees. So besides the view that gave it another one must see
    the point farther from where an infinitely far one would be than it may be off: `least`, normalised. What no view
    sees displaced by as much is where an infinitely far one would be, whatever its depth.
    """
    near, shifts = camera_from_world.apply(xyz), list[Array]()
    for pose, agree in others:
        there, far = pose.apply(xyz), rotate(pose.rotation @ camera_from_world.rotation.T, near[:, :2] / near[:, 2:])
        shift = np.linalg.norm(there[:, :2] / there[:, 2:] - far, axis=1)
        shifts.append(np.where(agree, shift, 0.0))
    largest = np.sort(np.stack(shifts), axis=0)[::-1]
    return (largest[1] > least) | (largest[0] <= least)


def at_middle(setup: Setup, place: Keyframe, uv: Array) -> Array:
    """Where the middle row would have seen what a place has at (N, 2) [px]; NaN for NaN."""
    if place.moving is None:
        return uv
    at = uv.astype(np.float32)
    return uv - late_px(setup.camera, at, nearest_speed(*place.moving, at))


def _seen(
    setup: Setup, extra: Array, place: Keyframe, index: NDArray[np.int64], other: Keyframe, sigma: float
) -> Array:
    """(N, 2) [px] where another place has these features of a place: on their epipolar lines; NaN where it has not."""
    assert place.features is not None and other.features is not None
    here, there = place.features, other.features
    if other is place:
        return here.uv[index].astype(float)
    motion = other.camera_from_world @ place.camera_from_world.inverse()
    both = at_middle(setup, place, here.uv[index]), at_middle(setup, other, there.uv)
    x, y = (corrected(setup.camera.normalise(uv), extra) for uv in both)
    out = np.full((len(index), 2), np.nan)
    allowed = on_epipolar_lines(motion, x, y, MAX_OFF * sigma)
    pairs, _ = setup.front_end.matcher.match_where(here[index], there, allowed)
    out[pairs[:, 0]] = there.uv[pairs[:, 1]]
    return out


def _agreeing(setup: Setup, extra: Array, place: Keyframe, uv: Array, xyz: Array, limit: float) -> Array:
    """(N, 2) [px] where a place has points (N, 3), NaN also where it has something else there. `limit` normalised."""
    near = place.camera_from_world.apply(xyz)
    x = corrected(setup.camera.normalise(at_middle(setup, place, uv)), extra)
    off = x - near[:, :2] / np.maximum(near[:, 2:], 1e-9)
    return np.where((np.linalg.norm(off, axis=1) < limit)[:, None] & (near[:, 2:] > 0), uv, np.nan)


def _intersected(setup: Setup, extra: Array, keyframes: list[Keyframe], seen: list[Array], sigma: float) -> Array:
    """Points (N, 3) in the world, NaN where not known well enough: by all the keyframes together or, as one may show
    another thing, by the last and the one that is farthest from it of those that agree."""
    xyz, last = np.full((len(seen[0]), 3), np.nan), len(keyframes) - 1
    for others in (range(last), *([i] for i in range(last))):
        chosen = [*others, last]
        found = rays_met(setup, extra, [keyframes[i] for i in chosen], [seen[i] for i in chosen], Noise(sigma))
        good = (found.depth > 0) & (found.worst < INLIER * sigma) & (found.significance > MIN_SIGNIFICANCE)
        good &= np.isnan(xyz[:, 0])
        xyz[good] = found.xyz_in_world[good]
    return xyz


def rays_met(setup: Setup, extra: Array, keyframes: list[Keyframe], seen: list[Array], noise: Noise) -> InverseDepths:
    """Along the rays of the last place, which has all the points."""
    stacked = np.stack([at_middle(setup, p, uv) for p, uv in zip(keyframes[::-1], seen[::-1], strict=True)])
    owners, cameras = np.nonzero(np.isfinite(stacked[:, :, 0]).T)
    poses = [p.camera_from_world for p in keyframes[::-1]]
    turns, ways = np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    x = corrected(setup.camera.normalise(stacked[cameras, owners]), extra)
    return intersect(turns, ways, cameras, owners, x, stacked.shape[1], noise)


def resighted(setup: Setup, database: KeyframeDatabase, world: Map, found: Recognised) -> Recognised:
    """What was found with its points (N, 3) intersected from where patches are, also in the window's other key frames.

    A descriptor's position is off by a pixel, and the two or three keyframes that were compared lie close together,
    before a turn above all: what was seen again by them alone held the pose after a gap less well than tracks do. Where
    patches do not agree with one still point, or no other keyframe has them, it stays as descriptors say.
    """
    place, at = found.views[-1]
    others, window = {p.time_ns: (p, uv) for p, uv in found.views[:-1]}, {k.time_ns for k in world.keys}
    if window & {*others, place.time_ns}:
        nowhere = np.full_like(at, np.nan)
        others = {p.time_ns: (p, nowhere) for p in database.keyframes if p.time_ns in window - {place.time_ns}} | others
    views = [others[time_ns] for time_ns in sorted(others)]
    patches = [_sighted(setup, world.extra, place, at, found.xyz, p) for p, _ in views]
    met = rays_met(setup, world.extra, [*(p for p, _ in views), place], [*patches, at], setup.noise)
    agree = (met.depth > 0) & (met.worst < INLIER * setup.noise.width) & (met.significance > MIN_PATCH_SIGNIFICANCE)
    agree &= np.isfinite(np.stack(patches)[:, :, 0]).any(axis=0)
    seen = [(p, np.where(agree[:, None], uv, old)) for (p, old), uv in zip(views, patches, strict=True)]
    return replace(found, views=(*seen, (place, at)), xyz=np.where(agree[:, None], met.xyz_in_world, found.xyz))


def _sighted(setup: Setup, extra: Array, place: Keyframe, at: Array, xyz: Array, other: Keyframe) -> Array:
    """(N, 2) [px] where another place has the patches that a place has `at` (N, 2) [px], of points (N, 3); else NaN."""
    lens, near = Lens(setup.camera, extra), other.camera_from_world.apply(xyz)
    expected = lens.in_image(near)
    some = np.flatnonzero(np.isfinite(expected[:, 0]) & np.isfinite(at[:, 0]))
    expected, uv = expected[some], np.full_like(at, np.nan)
    if other.moving is not None:
        middle = expected.astype(np.float32)
        expected = expected + late_px(setup.camera, middle, nearest_speed(*other.moving, middle))
    back = place.camera_from_world @ other.camera_from_world.inverse()
    found, good = patches_found(lens, place, at[some], back, near[some], other.images[0], expected, other.reduction)
    uv[some[good]] = found[good]
    return uv
