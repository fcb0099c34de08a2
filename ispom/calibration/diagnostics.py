"""Quality of a calibration: coverage of the image, uncertainty of projections, undetermined parameters, advice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.lens import model_of, parameter_names, vector_of
from ispom.calibration.adjust.solve import Solution
from ispom.cameras import project_with_derivatives
from ispom.geometry import Array, Pose, skew
from ispom.types import Camera

COLUMNS, ROWS = 8, 6
ENOUGH = 3
"""Views with a point in a cell."""
TILT_DEG, TILTED_VIEWS = 20.0, 4
"""Least number of views that should be tilted by this angle, about each of both axes."""
DEPTH_RATIO = 1.5
"""The farthest view should be farther than the nearest by this factor."""
MANY_VIEWS = 15
_VERTICAL = ("top", "middle", "bottom")
_HORIZONTAL = ("left", "centre", "right")


@dataclass(frozen=True, eq=False)
class Coverage:
    """Coverage by one camera's accepted views."""

    counts: NDArray[np.int64]
    """(ROWS, COLUMNS) views with a point in this cell of the image."""
    tilts_deg: Array
    """(V, 2) of the board about the image's horizontal and vertical axes."""
    distances_m: Array
    """(V,) of the board's points on the average."""
    advice: tuple[str, ...]
    """Advice on what to film next, in the order of importance; empty where nothing is missing."""

    @property
    def covered(self) -> float:
        """Share of the image's cells with ENOUGH views."""
        return float((self.counts >= ENOUGH).mean())


def coverage(
    camera: Camera, uv_of_views: list[Array], camera_from_board: list[Pose], centre_in_board: Array
) -> Coverage:
    """Measures the coverage by the views' points (N, 2) [px] and poses; `centre_in_board` (3,) is the middle of the
    board."""
    counts = np.zeros((ROWS, COLUMNS), np.int64)
    for uv in uv_of_views:
        column = (uv[:, 0] * COLUMNS / camera.width).astype(int).clip(0, COLUMNS - 1)
        row = (uv[:, 1] * ROWS / camera.height).astype(int).clip(0, ROWS - 1)
        counts[tuple(np.unique(np.stack([row, column]), axis=1))] += 1
    normals = np.array([pose.rotation[:, 2] for pose in camera_from_board]).reshape(-1, 3)
    tilts = np.degrees(np.arctan2(normals[:, [1, 0]], np.abs(normals[:, [2]])))
    distances = np.array([np.linalg.norm(pose.apply(centre_in_board)) for pose in camera_from_board])
    return Coverage(counts, tilts, distances, _advice(counts, tilts, distances))


def _advice(counts: NDArray[np.int64], tilts_deg: Array, distances_m: Array) -> tuple[str, ...]:
    out = []
    for axis, name in ((0, "backwards and forwards"), (1, "to the left and right")):
        for sign in (1, -1):
            if (sign * tilts_deg[:, axis] > TILT_DEG).sum() < TILTED_VIEWS / 2:
                out.append(f"tilt the board more {name}: by 30 to 45 degrees in several views")
                break
    bare = _bare_regions(counts)
    if bare:
        out.append(f"hold the board at the {', '.join(bare)} of the image, up to the border")
    if len(distances_m) and distances_m.max() < DEPTH_RATIO * distances_m.min():
        out.append("film the board from nearer and from farther away")
    if len(distances_m) < MANY_VIEWS:
        out.append(f"take more views: {len(distances_m)} are used, {MANY_VIEWS} to 40 are better")
    return tuple(out)


def _bare_regions(counts: NDArray[np.int64]) -> list[str]:
    """Returns those of the image's nine regions with less than half of their cells covered."""
    out = []
    for i, rows in enumerate(np.array_split(counts >= ENOUGH, 3)):
        for j, cells in enumerate(np.array_split(rows, 3, axis=1)):
            if cells.mean() < 0.5:
                out.append(f"{_VERTICAL[i]} {_HORIZONTAL[j]}")
    return out


MAP_COLUMNS, MAP_ROWS = 24, 16


@dataclass(frozen=True, eq=False)
class ImageMap:
    """Vectors or sizes on a grid over the image."""

    uv: Array
    """(R, C, 2) [px] where."""
    px: Array
    """(R, C) how much."""
    vectors: Array | None = None
    """(R, C, 2) [px] direction, where that is known."""


def grid_over(camera: Camera) -> Array:
    """(R C, 2) pixels, the image's corners included."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, MAP_COLUMNS), np.linspace(0, camera.height - 1, MAP_ROWS))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def uncertainty_map(camera: Camera, covariance: Array) -> ImageMap:
    """Standard deviation of the projection of far points, of the camera's covariance (P, P); the larger axis.

    Infinite where a parameter's variance is.
    """
    uv, rays = _seen_rays(camera)
    by_camera, by_turn = _jacobians(camera, rays)
    if not np.isfinite(np.diag(covariance)).all():
        return _shaped(uv, np.full(len(uv), np.inf))
    flat = by_camera.reshape(-1, by_camera.shape[2])
    rotation = by_turn.reshape(-1, 3)
    turned = flat - rotation @ np.linalg.lstsq(rotation, flat, rcond=None)[0]
    blocks = turned.reshape(by_camera.shape)
    variances = np.einsum("nip,pq,njq->nij", blocks, covariance, blocks)
    return _shaped(uv, np.sqrt(np.linalg.eigvalsh(variances)[:, -1].clip(0)))


def difference_map(one: Camera, other: Camera) -> ImageMap:
    """Projects the grid of one camera by the other, after the rotation that brings them nearest."""
    uv, rays = _seen_rays(one)
    turned = rays
    for _ in range(3):
        seen, by_point, _ = project_with_derivatives(other, turned)
        by_turn = -by_point @ skew(turned)
        step = np.linalg.lstsq(by_turn.reshape(-1, 3), (uv - seen).ravel(), rcond=None)[0]
        turned = turned + np.cross(step, turned)
    vectors = project_with_derivatives(other, turned)[0] - uv
    return ImageMap(
        uv.reshape(MAP_ROWS, MAP_COLUMNS, 2), np.linalg.norm(vectors, axis=1).reshape(MAP_ROWS, MAP_COLUMNS),
        vectors.reshape(MAP_ROWS, MAP_COLUMNS, 2),
    )  # fmt: skip


def _seen_rays(camera: Camera) -> tuple[Array, Array]:
    uv = grid_over(camera)
    xy = np.nan_to_num(camera.normalise(uv)).clip(-50, 50)
    rays = np.column_stack([xy, np.ones(len(xy))])
    return uv, rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _jacobians(camera: Camera, rays: Array) -> tuple[Array, Array]:
    """Returns derivatives of pixels by the camera's vector (N, 2, P), and by a rotation of the rays (N, 2, 3)."""
    _, by_point, by_camera = project_with_derivatives(camera, rays)
    return by_camera, -by_point @ skew(rays)


def _shaped(uv: Array, px: Array) -> ImageMap:
    return ImageMap(uv.reshape(MAP_ROWS, MAP_COLUMNS, 2), px.reshape(MAP_ROWS, MAP_COLUMNS))


FOCAL_SHARE, CENTRE_SHARE = 0.02, 0.03
"""A focal length uncertain by more than this share of itself is not determined, a principal point of the width;"""
BASELINE_SHARE, ROTATION_RAD = 0.05, np.radians(0.5)
"""a pose on the rig where its position is uncertain by this share of its distance (of 0.1 m at least), or its
rotation."""
LEAST_BASELINE_M = 0.1


@dataclass(frozen=True)
class Parameter:
    """One number of the calibration."""

    camera: str
    name: str
    """fx, fy, cx, cy [px], k1, ..., or x, y, z [m] and roll, pitch, yaw: the pose's own left twist [rad]."""
    value: float
    standard_error: float
    """Infinite where the views do not determine it at all."""
    determined: bool


def parameters(solution: Solution, names: tuple[str, ...]) -> tuple[Parameter, ...]:
    """Returns all parameters that the views share, in the order of the solution's covariance."""
    errors = np.sqrt(np.maximum(np.diag(solution.covariance), 0)) if len(solution.covariance) else np.zeros(0)
    out: list[Parameter] = []
    for c, (interior, pose) in enumerate(solution.unknowns.slices):
        camera = solution.estimate.cameras[c]
        free = solution.unknowns.interior[c]
        labels = np.array(parameter_names(model_of(camera)))[free]
        for label, value, error in zip(labels, vector_of(camera)[free], errors[interior], strict=True):
            limit = FOCAL_SHARE * abs(value) if label in ("fx", "fy") else CENTRE_SHARE * camera.width
            good = bool(np.isfinite(error) and (error <= limit or label not in ("fx", "fy", "cx", "cy")))
            out.append(Parameter(names[c], str(label), float(value), float(error), good))
        if solution.unknowns.pose[c]:
            out += _pose_parameters(solution, c, names[c], errors[pose])
    return tuple(out)


def correlations(solution: Solution) -> Array:
    """(G, G), 0 where a parameter is not determined."""
    errors = np.sqrt(np.maximum(np.diag(solution.covariance), 0))
    good = np.isfinite(errors) & (errors > 0)
    out = np.zeros_like(solution.covariance)
    inside = np.ix_(good, good)
    out[inside] = solution.covariance[inside] / np.outer(errors[good], errors[good])
    np.fill_diagonal(out, 1.0)
    return out


def _pose_parameters(solution: Solution, c: int, name: str, errors: Array) -> list[Parameter]:
    pose = solution.estimate.camera_from_rig[c]
    away = max(LEAST_BASELINE_M, float(np.linalg.norm(pose.translation)))
    labels = ("x", "y", "z", "roll", "pitch", "yaw")
    values = np.concatenate([pose.translation, pose.rotvec])
    limits = [BASELINE_SHARE * away] * 3 + [float(ROTATION_RAD)] * 3
    return [
        Parameter(name, label, float(value), float(error), bool(np.isfinite(error) and error <= limit))
        for label, value, error, limit in zip(labels, values, errors, limits, strict=True)
    ]
