"""Views of a board by one or several cameras of a rig as one least-squares problem.

Unknown: each camera's interior, the pose of every camera but the first on the rig, and the board's pose in each view.
The first camera is the rig here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.lens import vector_of, with_vector
from ispom.calibration.detection.detection import Detection
from ispom.calibration.targets.target import Target
from ispom.cameras import project_with_derivatives
from ispom.geometry import Array, Pose, skew
from ispom.numerics.twist import moved
from ispom.solvers.least_squares import Derivatives, Family, Loss, Problem, quadratic
from ispom.types import Camera


@dataclass(frozen=True, eq=False)
class Observations:
    """All observations, ordered by view and camera."""

    camera: NDArray[np.int64]
    """(M,) index of the camera,"""
    view: NDArray[np.int64]
    """(M,) index of the view,"""
    point: NDArray[np.int64]
    """(M,) index of the target's point,"""
    xyz_in_board: Array
    """(M, 3) and its position [m]."""
    uv: Array
    """(M, 2) [px]."""
    sigma_px: Array
    """(M,) the same for all of a detector: single values reveal vague corners, and are too rough as weights."""

    def __len__(self) -> int:
        return len(self.camera)

    def select(self, keep: NDArray[np.bool_]) -> Observations:
        return Observations(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def of_views(self, views: NDArray[np.int64]) -> Observations:
        """Selects some views (increasing), and numbers them from 0."""
        part = self.select(np.isin(self.view, views))
        return replace(part, view=np.searchsorted(views, part.view))

    def with_uv(self, uv: Array) -> Observations:
        return replace(self, uv=uv)

    @staticmethod
    def of(target: Target, detections: Sequence[Sequence[Detection]]) -> Observations:
        """Collects detections [camera][view]; those without points are ignored."""
        middle = np.median(np.concatenate([d.sigma_px for of_camera in detections for d in of_camera]))
        parts = [
            (
                np.full(len(d), c),
                np.full(len(d), v),
                d.ids,
                target.xyz_in_board[d.ids],
                d.uv,
                np.full(len(d), middle),
            )
            for v in range(len(detections[0]))
            for c, d in ((c, of_camera[v]) for c, of_camera in enumerate(detections))
        ]
        return Observations(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True, eq=False)
class Estimate:
    """The parameters of the adjustment."""

    cameras: tuple[Camera, ...]
    camera_from_rig: tuple[Pose, ...]
    rotations: Array
    """(V, 3, 3) and"""
    positions: Array
    """(V, 3) [m]: rig_from_board of each view."""

    @property
    def views(self) -> int:
        return len(self.rotations)

    @staticmethod
    def of(cameras: tuple[Camera, ...], camera_from_rig: tuple[Pose, ...], boards: Sequence[Pose]) -> Estimate:
        rotations, positions = [pose.rotation for pose in boards], [pose.translation for pose in boards]
        return Estimate(cameras, camera_from_rig, np.stack(rotations), np.stack(positions))

    def rig_from_board(self, view: int) -> Pose:
        """Returns the pose of the board in a view."""
        return Pose(self.rotations[view], self.positions[view])

    def residuals_px(self, seen: Observations) -> Array:
        """Returns predicted minus observed pixels (M, 2); NaN behind a camera."""
        out = np.full((len(seen), 2), np.nan)
        for c, camera in enumerate(self.cameras):
            mine = seen.camera == c
            out[mine] = camera.project(self.in_camera(seen, c, mine)[1]) - seen.uv[mine]
        return out

    def in_camera(self, seen: Observations, c: int, mine: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Returns camera c's points (N, 3) in the rig, and in the camera."""
        view = seen.view[mine]
        in_rig = (self.rotations[view] @ seen.xyz_in_board[mine][..., None])[..., 0] + self.positions[view]
        return in_rig, self.camera_from_rig[c].apply(in_rig)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Which parameters are adjusted, and their indices among those that all views share."""

    interior: tuple[NDArray[np.int64], ...]
    """Indices of the free elements of each camera's vector."""
    pose: tuple[bool, ...]
    """The camera's pose on the rig is free."""

    @staticmethod
    def all_of(estimate: Estimate, interior: bool = True, apart: int | None = None) -> Unknowns:
        """Frees everything but the first camera's pose, or not the interiors.

        The camera `apart` shares no view with the others, so that these do not determine its pose.
        """
        free = tuple(np.arange(len(vector_of(camera)) if interior else 0) for camera in estimate.cameras)
        return Unknowns(free, tuple(c > 0 and c != apart for c in range(len(estimate.cameras))))

    @property
    def slices(self) -> tuple[tuple[slice, slice], ...]:
        """Slices of each camera's interior and pose."""
        out, at = [], 0
        for free, moves in zip(self.interior, self.pose, strict=True):
            middle = at + len(free)
            end = middle + (6 if moves else 0)
            out.append((slice(at, middle), slice(middle, end)))
            at = end
        return tuple(out)

    @property
    def count(self) -> int:
        return self.slices[-1][1].stop

    def moved(self, values: Estimate, shared: Array, blocks: Array) -> Estimate:
        """Adds to the interiors, and moves poses by left twists; `blocks` (V, 6) are those of the views."""
        cameras, poses = [], []
        for c, (interior, pose) in enumerate(self.slices):
            vector = vector_of(values.cameras[c])
            vector[self.interior[c]] += shared[interior]
            cameras.append(with_vector(values.cameras[c], vector))
            twist = Pose.exp(shared[pose]) if self.pose[c] else Pose()
            poses.append(twist @ values.camera_from_rig[c])
        return Estimate(tuple(cameras), tuple(poses), *moved(values.rotations, values.positions, blocks))


def board_problem(seen: Observations, unknowns: Unknowns, views: int, loss: Loss = quadratic) -> Problem[Estimate]:
    """The views of a board; their poses are the blocks."""
    return Problem((Corners(seen, unknowns, loss),), unknowns.moved, unknowns.count, views, 6)


@dataclass(frozen=True, eq=False)
class Corners(Family[Estimate]):
    """Errors of a board's points in the images [px]."""

    seen: Observations
    unknowns: Unknowns
    loss: Loss

    @property
    def widths(self) -> Array:
        return self.seen.sigma_px

    def residuals(self, values: Estimate) -> Array:
        return values.residuals_px(self.seen)

    def derivatives(self, values: Estimate) -> Derivatives:
        seen, most = self.seen, max(4 + len(camera.distortion) for camera in values.cameras)
        by_shared, columns = np.zeros((len(seen), 2, most + 6)), np.full((len(seen), most + 6), -1)
        by_view = np.zeros((len(seen), 2, 6))
        for c, camera in enumerate(values.cameras):
            mine = seen.camera == c
            in_rig, in_camera = values.in_camera(seen, c, mine)
            in_camera = np.where(in_camera[:, 2:] > 1e-6, in_camera, [0, 0, 1.0])
            _, by_point, by_camera = project_with_derivatives(camera, in_camera)
            by_shared[mine, :, : by_camera.shape[2]] = by_camera
            by_shared[mine, :, most:] = by_twist(by_point, in_camera)
            interior, pose = self.unknowns.slices[c]
            own = np.full(most + 6, -1)
            own[self.unknowns.interior[c]] = np.arange(interior.start, interior.stop)
            own[most:] = np.arange(pose.start, pose.stop) if self.unknowns.pose[c] else -1
            columns[mine] = own
            by_view[mine] = by_twist(by_point @ values.camera_from_rig[c].rotation, in_rig)
        return Derivatives(by_shared, columns, by_view, seen.view)


def by_twist(by_point: Array, xyz: Array) -> Array:
    """Returns derivatives (N, 2, 6) by a left twist of points (N, 3), from those by the points (N, 2, 3)."""
    return np.concatenate([by_point, -by_point @ skew(xyz)], axis=2)
