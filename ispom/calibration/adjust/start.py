"""First values: a focal length of a coarse row of candidates, and the board's pose in every view by itself."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from ispom.calibration.adjust.lens import Model, as_model
from ispom.calibration.adjust.problem import Estimate, Observations, Unknowns
from ispom.calibration.adjust.solve import adjusted
from ispom.geometry import Array, Pose
from ispom.types import Camera

FOCALS = np.geomspace(0.25, 6.0, 20)
"""Focal lengths that are tried, as shares of the image's longer side."""
TRIED_VIEWS = 12
HUBER_SIGMAS = 20.0
POOR_SHARE = 0.1
"""Of a view's extent in the image: a pose that misses by more is none."""


def start_of(seen: Observations, size: tuple[int, int], model: Model) -> Estimate:
    """One camera with an image (width, height): its first values for a model, refined a little, and the views' poses.

    `seen` is of this camera alone, its views numbered without gaps.
    """
    views = int(seen.view.max()) + 1
    some = np.unique(np.linspace(0, views - 1, min(views, TRIED_VIEWS)).astype(int))
    few = seen.of_views(some)
    best = min((_candidate(few, size, model, float(f)) for f in FOCALS), key=lambda found: found[0])[1]
    simple: Model = "fisheye" if model == "fisheye" else "pinhole"
    for each in dict.fromkeys((simple, "radtan" if simple == "pinhole" else simple, model)):
        if simple == "pinhole" and model == "pinhole" and each != "pinhole":
            continue
        camera = as_model(best.cameras[0], each)
        free = np.arange(4 + len(camera.distortion)) if each != "pinhole" or model == "pinhole" else np.array([0, 1])
        start = replace(best, cameras=(camera,))
        best = adjusted(start, few, Unknowns((free,), (False,)), HUBER_SIGMAS, iterations=25)
    return with_views(best.cameras[0], seen)


def with_views(camera: Camera, seen: Observations) -> Estimate:
    """The camera, with the pose of each view of one camera's observations."""
    return Estimate.of((camera,), (Pose(),), board_poses(camera, seen))


def board_poses(camera: Camera, seen: Observations) -> list[Pose]:
    """camera_from_board of each view (0 to the last; identity 1 m ahead where a view has too few points)."""
    return [_pose(camera, seen.select(seen.view == v))[0] for v in range(int(seen.view.max()) + 1)]


def _candidate(seen: Observations, size: tuple[int, int], model: Model, share: float) -> tuple[float, Estimate]:
    """The median error [px], and a camera of this focal length with the poses that fit it best."""
    focal = share * max(size)
    camera = as_model(Camera(*size, focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2), model)
    found = [_pose(camera, seen.select(seen.view == v)) for v in range(int(seen.view.max()) + 1)]
    error = float(np.median([away for _, away in found]))
    return error, Estimate.of((camera,), (Pose(),), [pose for pose, _ in found])


def _pose(camera: Camera, seen: Observations) -> tuple[Pose, float]:
    """camera_from_board of one view, and its error [px]: of the two poses that a plane allows, the better one."""
    nowhere = Pose(translation=np.array([0, 0, 1.0]))
    rays = camera.normalise(seen.uv)
    good = np.isfinite(rays).all(1) & (np.abs(rays) < 20).all(1)
    if good.sum() < 4:
        return nowhere, np.inf
    board, rays = np.ascontiguousarray(seen.xyz_in_board[good]), np.ascontiguousarray(rays[good])
    centre = board.mean(0)
    found, turns, moves, _ = cv2.solvePnPGeneric(
        (board - centre)[:, None], rays[:, None], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    poses = (
        [
            Pose.from_rotvec(np.asarray(r, float), np.asarray(t, float)) @ Pose(translation=-centre)
            for r, t in zip(turns, moves, strict=True)
        ]
        if found
        else []
    )
    errors = [_error_px(camera, pose, seen) for pose in poses]
    if not errors or not np.isfinite(min(errors)):
        return nowhere, np.inf
    best = int(np.argmin(errors))
    return poses[best], errors[best]


def _error_px(camera: Camera, camera_from_board: Pose, seen: Observations) -> float:
    away: Array = camera.project(camera_from_board.apply(seen.xyz_in_board)) - seen.uv
    distances = np.linalg.norm(away, axis=1)
    return float(np.sqrt((distances**2).mean())) if np.isfinite(distances).all() else np.inf
