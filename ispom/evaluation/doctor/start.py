"""A first scene of the tracks: two views, then the other poses, then the scale of the stereo pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.reductions import lengths
from ispom.solvers.localisation import Policy, locate
from ispom.solvers.multiview.essential import sampson_distance
from ispom.solvers.multiview.rotation import dominant_rotation, rotate
from ispom.solvers.multiview.two_view import hypotheses
from ispom.types import Rig

from .adjustment import LOSS_PX, adjust
from .scene import CAMERAS, Observations, Scene
from .stretch import Stretch
from .tracking import Tracked

KNOTS = 30
"""Most poses of a scene."""
LEAST_TRACKS = 30
SIGNIFICANT = 5.0
"""Median residual of a pure rotation over that of two views with parallax, between the first two views. A camera that
only turned has about 2: one residual has two dimensions, the other one."""
LEAST_NOISE_PX = 0.1
"""Noise of a track from a frame to another, at least: corners are tracked no better."""
FIRST_VIEWS = 3
"""Pairs of frames from which a scene is tried."""
PLANAR = 0.7
"""Share of the inliers of an essential matrix that a homography explains, from which on the scene may be a plane."""
REFINEMENTS = 2
SURE_PX = 2.0
"""Error of an inlier while the scene grows."""


@dataclass(frozen=True, eq=False)
class Start:
    """A scene, and all observations of its points. Points with an even number are not fitted, but used for tests."""

    scene: Scene
    seen: Observations
    held_out: NDArray[np.bool_]
    """(P,)"""
    knots: NDArray[np.int64]
    """(K,) main frames of the poses."""


def start(seen: Stretch, tracked: Tracked) -> Start | None:
    """Returns the first scene; None where the tracks are too few, or show no parallax."""
    shots = seen.main_shots
    if len(shots) < 5:
        return None
    knots = _knots(seen)
    uv = tracked.uv[:, knots]
    long = np.isfinite(uv[..., 0]).sum(axis=1) >= 3
    uv = uv[long]
    if long.sum() < LEAST_TRACKS:
        return None
    camera = seen.rig.camera(seen.main)
    rays = camera.normalise(uv.reshape(-1, 2)).reshape(uv.shape)
    candidates = [
        grown
        for a, b in _first_views(rays, camera.fx)
        for b_from_a in _motions(rays[:, a], rays[:, b], camera.fx)
        if (grown := _grow(rays, camera.fx, {a: Pose(), b: b_from_a.inverse()})) is not None
    ]
    if not candidates:
        return None
    poses, points = max(candidates, key=lambda grown: int(np.isfinite(grown[1][:, 0]).sum()))
    poses, points = _refined(seen, knots, uv, rays, poses, points)
    if np.isfinite(points[:, 0]).sum() < LEAST_TRACKS:
        return None
    rig_from_camera = seen.rig.rig_from(seen.main)
    camera_from_rig = rig_from_camera.inverse()
    rows = np.flatnonzero(np.isfinite(points[:, 0]))
    times_s = (np.array([shots[k].time_ns for k in knots]) - shots[0].time_ns) * 1e-9
    left, right = tracked.left[long][rows], tracked.right[long][rows]
    pair_times_s = np.array([(shot.time_ns - shots[0].time_ns) * 1e-9 for shot in seen.pairs])
    inside = (pair_times_s >= times_s[0] - 1e-9) & (pair_times_s <= times_s[-1] + 1e-9)
    scale = _scale(seen.rig, poses, points[rows], times_s, left, right, pair_times_s) if inside.any() else None
    factor = 1.0 if scale is None else scale
    rig_poses = [Pose(p.rotation, factor * p.translation) @ camera_from_rig for p in poses]
    scene = Scene(
        times_s,
        np.array([p.rotation for p in rig_poses]),
        np.array([p.translation for p in rig_poses]),
        factor * points[rows],
    )
    parts = [_observed(seen.main, uv[rows], times_s)]
    if scale is not None:
        stamps = pair_times_s[inside]
        parts += [_observed("right", right[:, inside], stamps)]
        parts += [_observed("left", left[:, inside], stamps)] if seen.main != "left" else []
    every = Observations(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("camera", "time_s", "point", "uv"))
    )
    return Start(scene, every, np.arange(len(rows)) % 2 == 0, knots)


def _knots(seen: Stretch) -> NDArray[np.int64]:
    """Returns the main frames whose poses are sought: two before and two after each pair, and others in even steps."""
    times_ns = np.array([shot.time_ns for shot in seen.main_shots])
    chosen = {0, len(times_ns) - 1}
    for pair in seen.pairs:
        after = int(np.searchsorted(times_ns, pair.time_ns))
        chosen |= {k for k in range(after - 2, after + 2) if 0 <= k < len(times_ns)}
    stride = max(4, -(-len(times_ns) // KNOTS)) if seen.pairs else -(-len(times_ns) // KNOTS)
    every = range(0, len(times_ns), stride) if seen.main == "video" else range(len(times_ns))
    chosen |= {k for k in every if min(abs(k - c) for c in chosen) >= min(stride, 2)}
    return np.array(sorted(chosen))


def _observed(camera: str, uv: Array, times_s: Array) -> Observations:
    point, frame = np.nonzero(np.isfinite(uv[..., 0]))
    return Observations(np.full(len(point), CAMERAS.index(camera)), times_s[frame], point, uv[point, frame])


def _refined(
    seen: Stretch, knots: NDArray[np.int64], uv: Array, rays: Array, poses: list[Pose], points: Array
) -> tuple[list[Pose], Array]:
    """Adjusts the scene by the main camera alone, and triangulates all tracks again."""
    camera, shots = seen.rig.camera(seen.main), seen.main_shots
    times_s = (np.array([shots[k].time_ns for k in knots]) - shots[0].time_ns) * 1e-9
    alone = Rig.of(**{seen.main: camera})
    for _ in range(REFINEMENTS):
        rows = np.flatnonzero(np.isfinite(points[:, 0]))
        if len(rows) < LEAST_TRACKS:
            break
        scene = Scene(
            times_s, np.array([p.rotation for p in poses]), np.array([p.translation for p in poses]), points[rows]
        )
        scene, _, _ = adjust(scene, alone, _observed(seen.main, uv[rows], times_s), (), 10)
        poses = [Pose(r, t) for r, t in zip(scene.rotations, scene.positions, strict=True)]
        points = _triangulate(rays, dict(enumerate(poses)), camera.fx)
    return poses, points


def _motions(a: Array, b: Array, focal_px: float) -> list[Pose]:
    """Returns b_from_a, of normalised coordinates (P, 2): by the essential matrix, and by the homography where that
    explains most of them, as of a plane. None without parallax."""
    both = np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
    found = hypotheses(a[both], b[both], SURE_PX / 2 / focal_px)
    poses = found.second_from_first if found.planar_share > PLANAR else found.second_from_first[: found.essential]
    return [pose for pose in poses if significance(a, b, pose, focal_px) >= SIGNIFICANT]


def _grow(rays: Array, focal_px: float, poses: dict[int, Pose]) -> tuple[list[Pose], Array] | None:
    """Returns world_from_camera of all frames, and points (P, 3), from those of two frames and normalised coordinates
    (P, K, 2)."""
    a, b = sorted(poses)
    points = _triangulate(rays, poses, focal_px)
    policy = Policy(LOSS_PX / focal_px, SURE_PX * 1.5 / focal_px, SURE_PX * 1.5 / focal_px)
    order = sorted(set(range(rays.shape[1])) - {a, b}, key=lambda k: (max(a - k, k - b, 0), k))
    for k in order:
        both = np.isfinite(rays[:, k, 0]) & np.isfinite(points[:, 0])
        if both.sum() < 8:
            return None
        nearest = poses[min(poses, key=lambda other: abs(other - k))].inverse()
        found = locate(points[both], rays[both, k], nearest, policy)
        if found is None or found.inliers.sum() < 8:
            return None
        poses[k] = found.camera_from_world.inverse()
        points = np.where(np.isfinite(points), points, _triangulate(rays, poses, focal_px))
    return [poses[k] for k in range(rays.shape[1])], _triangulate(rays, poses, focal_px)


def _first_views(rays: Array, focal_px: float) -> list[tuple[int, int]]:
    """Returns a few pairs of frames with much parallax of many tracks, the best first."""
    found: list[tuple[float, int, int]] = []
    count = rays.shape[1]
    for a in range(0, max(1, count - 3), 3):
        for b in range(a + 2, count, 3):
            both = np.isfinite(rays[:, a, 0]) & np.isfinite(rays[:, b, 0])
            if both.sum() >= LEAST_TRACKS:
                parallax = float(np.median(rotation_residuals(rays[both, a], rays[both, b]))) * focal_px
                found.append((parallax * min(1.0, both.sum() / 100) ** 2, a, b))
    good = sorted(found, reverse=True)[: max(FIRST_VIEWS, len(found) // 4)]
    return [(a, b) for _, a, b in good[:: max(1, len(good) // FIRST_VIEWS)]][:FIRST_VIEWS]


def significance(a: Array, b: Array, b_from_a: Pose, focal_px: float) -> float:
    """Returns how many times better two views with parallax explain normalised coordinates (P, 2) than a rotation does:
    the ratio of the median distances from the epipolar lines and from the rotated points."""
    both = np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
    away = np.abs(sampson_distance(b_from_a, a[both], b[both]))
    noise = max(float(np.median(away)), LEAST_NOISE_PX / focal_px)
    return float(np.median(rotation_residuals(a[both], b[both]))) / noise


def rotation_residuals(a: Array, b: Array) -> Array:
    """Returns distances (N,) of normalised coordinates `b` from `a` after the best rotation, on the plane z = 1."""
    error, weights = np.zeros(len(a)), np.ones(len(a))
    for _ in range(5):
        error = lengths(rotate(dominant_rotation(a, b, 1.0, 1, weights), a) - b)
        weights = 1 / (np.median(error) ** 2 + error**2 + 1e-12)
    return error


def triangulate(rays: Array, poses: dict[int, Pose]) -> tuple[Array, Array]:
    """Returns points (P, 3) by linear least squares of normalised coordinates (P, K, 2), NaN where fewer than two
    frames see one, and their median errors (P,) on the plane z = 1, infinite behind a camera."""
    count = len(rays)
    matrix, vector, views = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count, int)
    for k, pose in poses.items():
        here = np.isfinite(rays[:, k, 0])
        direction = np.column_stack([rays[here, k], np.ones(here.sum())]) @ pose.rotation.T
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        matrix[here] += across
        vector[here] += across @ pose.translation
        views[here] += 1
    points, some = np.full((count, 3), np.nan), views >= 2
    points[some] = np.linalg.solve(matrix[some] + 1e-9 * np.eye(3), vector[some][..., None])[..., 0]
    errors = np.full((count, len(poses)), np.nan)
    for n, (k, pose) in enumerate(poses.items()):
        here = np.isfinite(rays[:, k, 0]) & some
        seen = pose.inverse().apply(points[here])
        with np.errstate(all="ignore"):
            apart = np.linalg.norm(seen[:, :2] / seen[:, 2:] - rays[here, k], axis=1)
        errors[here, n] = np.where(seen[:, 2] > 0, apart, np.inf)
    typical = np.full(count, np.inf)
    typical[some] = np.nanmedian(errors[some], axis=1)
    return points, typical


def _triangulate(rays: Array, poses: dict[int, Pose], focal_px: float) -> Array:
    """Returns points (P, 3); NaN where a point is behind a camera or fits nowhere."""
    points, errors = triangulate(rays, poses)
    points[~(errors * focal_px < 4 * SURE_PX)] = np.nan
    return points


def _scale(
    rig: Rig, poses: list[Pose], points: Array, times_s: Array, left: Array, right: Array, pair_times_s: Array
) -> float | None:
    """Returns metres per unit of the scene, by the depths of the pair; None where the pair shows too few points."""
    camera, ratios = rig.camera("left"), []
    for q, time_s in enumerate(pair_times_s):
        k = int(np.abs(times_s - time_s).argmin())
        disparity = left[:, q, 0] - right[:, q, 0]
        good = np.isfinite(disparity) & (disparity > 0.5)
        depth = camera.fx * rig.baseline_m / disparity[good]
        in_camera = poses[k].inverse().apply(points[good])[:, 2]
        ratios += (depth / in_camera)[in_camera > 0].tolist()
    return float(np.median(ratios)) if len(ratios) >= LEAST_TRACKS // 2 else None
