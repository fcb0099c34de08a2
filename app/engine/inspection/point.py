"""The 3-D point of a track: its position, its covariance, and the residual in each image.

All residuals are in ideal pixels: pixels of a camera with the same matrix and no distortion, as in the estimators.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ispom.estimators.modern.lens import Lens
from ispom.geometry import Array, Pose, skew
from ispom.numerics.reprojection import reprojected
from ispom.solvers.multiview.structure import intersected
from ispom.types import Rig, Trajectory

from .sightings import Observation, TrackLife


@dataclass(frozen=True, eq=False)
class PointEstimate:
    """The estimated point, in the world and unit of the track's method."""

    xyz_in_world: Array
    """(3,)."""
    covariance: Array | None
    """(3, 3) to first order, for exact poses; None where the views do not determine the distance."""
    from_exposure: int | None
    """The frame that gave it as a landmark; None where it was intersected here from all observations."""
    residuals_px: Array
    """(N,) reprojection error of each observation; NaN where an observation has no pose or did not find the track."""


def ideal(lens: Lens, uv: Array) -> Array:
    """Ideal pixels (N, 2) of pixels (N, 2)."""
    camera = lens.camera
    return lens.normalise(uv) * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def estimate(life: TrackLife, lens: Lens, rig: Rig, sigma_px: float) -> PointEstimate | None:
    """Returns the latest position as a landmark, or else the intersection of all observations; None where they do not
    determine one. `sigma_px` is the standard deviation of an observed coordinate."""
    views = [s for s in life.seen if s.world_from_camera is not None]
    located = next((s for s in reversed(life.observations) if s.xyz_in_world is not None), None)
    baseline_m = rig.baseline_m if life.camera == "left" and rig.has_stereo else 0.0
    xyz = _intersection(views, lens, baseline_m) if located is None else located.xyz_in_world
    if xyz is None:
        return None
    disparities = np.array([s.disparity_px for s in views])
    spread = covariance(xyz, [_pose(s) for s in views], lens, sigma_px, disparities, baseline_m)
    return PointEstimate(xyz, spread, located.index if located else None, residuals(life, lens, xyz))


def residuals(life: TrackLife, lens: Lens, xyz_in_world: Array) -> Array:
    """Returns (N,) [px] of each observation."""
    found = np.full(len(life.observations), np.nan)
    for i, observation in enumerate(life.observations):
        if observation.world_from_camera is not None and not observation.status.dropped:
            xyz = observation.world_from_camera.inverse().apply(xyz_in_world)
            if xyz[2] > 1e-9:
                found[i] = np.linalg.norm(_project(lens, xyz) - ideal(lens, observation.uv[None])[0])
    return found


def covariance(
    xyz_in_world: Array,
    world_from_camera: list[Pose],
    lens: Lens,
    sigma_px: float,
    disparity_px: Array,
    baseline_m: float = 0.0,
) -> Array | None:
    """(3, 3) of a point seen from these N cameras, from the linearised observations: the inverse of their information
    (Hartley and Zisserman 5.2). Where disparity_px (N,) is finite, the right camera saw it, too. None where singular.
    """
    information, camera = np.zeros((3, 3)), lens.camera
    for pose, disparity in zip(world_from_camera, disparity_px, strict=True):
        xyz = pose.inverse().apply(xyz_in_world)[None]
        if xyz[0, 2] <= 1e-9:
            continue
        rows = [reprojected(xyz)[1][0] * np.array([[camera.fx], [camera.fy]])]
        if np.isfinite(disparity) and baseline_m:
            rows.append(reprojected(xyz - (baseline_m, 0, 0))[1][0, :1] * camera.fx)
        by_world = np.concatenate(rows) @ pose.rotation.T / sigma_px
        information += by_world.T @ by_world
    if np.linalg.cond(information) > 1e12:
        return None
    return np.linalg.inv(information)


def _project(lens: Lens, xyz_in_camera: Array) -> Array:
    """Ideal pixel (2,) of a point (3,) before the camera."""
    camera = lens.camera
    return xyz_in_camera[:2] / xyz_in_camera[2] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def _intersection(views: list[Observation], lens: Lens, baseline_m: float) -> Array | None:
    """Returns the position (3,) whose projections are nearest to the observations; None where they do not determine
    its distance."""
    if not views:
        return None
    poses = Trajectory.of([(s.time_ns, _pose(s)) for s in views])
    uv, disparity = ideal(lens, np.stack([s.uv for s in views])), np.array([s.disparity_px for s in views])
    disparity = disparity if baseline_m else np.full(len(views), np.nan)
    pinhole, same = replace(lens.camera, distortion=()), np.zeros(len(views), np.int64)
    _, start = intersected(poses, pinhole, np.arange(len(views)), same, uv, disparity, baseline_m)
    if not len(start):
        return None
    from_world = [_pose(s).inverse() for s in views]
    paired = np.isfinite(disparity)

    def errors(xyz_in_world: Array) -> Array:
        xyz = np.stack([pose.apply(xyz_in_world) for pose in from_world])
        found = np.stack([_project(lens, each) for each in xyz])
        of_pair = lens.camera.fx * baseline_m / xyz[paired, 2] - disparity[paired]
        right = found[paired, 0] - uv[paired, 0] - of_pair
        return np.concatenate([(found - uv).ravel(), right])

    return least_squares(errors, start[0], method="lm").x


def _pose(observation: Observation) -> Pose:
    if observation.world_from_camera is None:
        raise ValueError(f"the observation at frame {observation.index} has no pose: use those that have one")
    return observation.world_from_camera


DEPTHS = 64
"""Points of the line that is drawn."""
NO_BASELINE = 1e-9
"""Relative to the distance from the origin: such motions are a rotation alone, where every point is its own line."""


@dataclass(frozen=True, eq=False)
class EpipolarLine:
    distance_px: float
    """Of the point seen in the second view from the line, in ideal pixels; NaN where the camera only turned."""
    curve_uv: Array
    """(K, 2) [px] where points on the ray are seen, from the nearest to infinity; distortion bends it."""


def epipolar(
    lens: Lens, world_from_first: Pose, world_from_second: Pose, uv_first: Array, uv_second: Array
) -> EpipolarLine:
    """Of pixel uv_first (2,), in the second view, where uv_second (2,) is seen (Hartley and Zisserman 9.1)."""
    second_from_first = world_from_second.inverse() @ world_from_first
    essential = skew(second_from_first.translation) @ second_from_first.rotation
    ray = np.append(lens.normalise(uv_first[None])[0], 1.0)
    k_inverse = np.linalg.inv(lens.camera.matrix)
    line = k_inverse.T @ essential @ ray
    normal = float(np.linalg.norm(line[:2]))
    scale = max(float(np.linalg.norm(world_from_first.translation)), 1.0)
    still = float(np.linalg.norm(second_from_first.translation)) < NO_BASELINE * scale or normal == 0
    distance = np.nan if still else abs(float(line @ np.append(ideal(lens, uv_second[None])[0], 1.0))) / normal
    return EpipolarLine(distance, _curve(lens, second_from_first, ray))


def _curve(lens: Lens, second_from_first: Pose, ray: Array) -> Array:
    """Where the ray (3,) is seen, at depths from a tenth of the baseline to infinity."""
    near = 0.1 * float(np.linalg.norm(second_from_first.translation)) or 1.0
    inverse_depth = np.linspace(1.0, 0.0, DEPTHS)[:, None] ** 3 / near  # denser far away, where most points are
    homogeneous = ray @ second_from_first.rotation.T + inverse_depth * second_from_first.translation
    homogeneous = homogeneous[homogeneous[:, 2] > 1e-3]
    camera = lens.camera
    flat = homogeneous[:, :2] / homogeneous[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    size = np.array([camera.width, camera.height])
    near_image = ((flat > -0.2 * size) & (flat < 1.2 * size)).all(1)  # beyond, the distortion's model folds back
    return lens.project(homogeneous[near_image])
