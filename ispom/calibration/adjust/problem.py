"""Views of a board by one or several cameras of a rig as one least-squares problem.

Unknown: each camera's interior, the pose of every camera but the first on the rig, and the board's pose in each view.
The first camera is the rig here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.adjust.lens import projected, vector_of, with_vector
from ispom.calibration.detection.detection import Detection
from ispom.calibration.targets.target import Target
from ispom.geometry import Array, Pose, skew, so3_exp
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


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """J'WJ and J'Wr by the shared parameters (G) and by each view's pose (V, 6)."""

    shared: Array
    """(G, G)."""
    mixed: Array
    """(V, G, 6)."""
    views: Array
    """(V, 6, 6)."""
    shared_gradient: Array
    """(G,)."""
    view_gradients: Array
    """(V, 6)."""

    def reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """Returns the shared parameters' (G, G) and (G,) with the views eliminated (Schur), and the views' inverses."""
        views = self.views * (1 + damping * np.eye(6)) + 1e-12 * np.eye(6)
        inverse = np.linalg.inv(views)
        gain = self.mixed @ inverse
        shared = self.shared * (1 + damping * np.eye(len(self.shared)))
        matrix = shared - np.einsum("vgi,vhi->gh", gain, self.mixed)
        return matrix, self.shared_gradient - np.einsum("vgi,vi->g", gain, self.view_gradients), inverse

    def step(self, damping: float) -> tuple[Array, Array]:
        """(G,) and (V, 6) that lower the cost."""
        matrix, gradient, inverse = self.reduced(damping)
        scale = 1 / np.sqrt(np.maximum(np.diag(self.shared), 1e-30))
        shared = -scale * np.linalg.lstsq(matrix * np.outer(scale, scale), scale * gradient, rcond=1e-15)[0]
        rest = self.view_gradients + np.einsum("vgi,g->vi", self.mixed, shared)
        return shared, -np.einsum("vij,vj->vi", inverse, rest)


def normal_equations(estimate: Estimate, seen: Observations, unknowns: Unknowns, weights: Array) -> NormalEquations:
    """Computes the equations at an estimate, with weights (M,) of squared residuals in px."""
    count, views = unknowns.count, len(estimate.rotations)
    out = NormalEquations(
        np.zeros((count, count)),
        np.zeros((views, count, 6)),
        np.zeros((views, 6, 6)),
        np.zeros(count),
        np.zeros((views, 6)),
    )
    for c, camera in enumerate(estimate.cameras):
        mine = seen.camera == c
        in_rig, in_camera = estimate.in_camera(seen, c, mine)
        ahead = in_camera[:, 2] > 1e-6
        in_camera = np.where(ahead[:, None], in_camera, [0, 0, 1.0])
        uv, by_point, by_camera = projected(camera, in_camera)
        root = np.sqrt(np.where(ahead, weights[mine], 0))[:, None]
        residual = root * (uv - seen.uv[mine])
        by_point = root[..., None] * by_point
        blocks = [root[..., None] * by_camera[..., unknowns.interior[c]]]
        if unknowns.pose[c]:
            blocks.append(np.concatenate([by_point, -by_point @ skew(in_camera)], axis=2))
        in_rig_frame = by_point @ estimate.camera_from_rig[c].rotation
        by_view = np.concatenate([in_rig_frame, -in_rig_frame @ skew(in_rig)], axis=2).reshape(-1, 6)
        shared = np.concatenate(blocks, axis=2).reshape(len(by_view), -1)
        flat = residual.ravel()
        interior, pose = unknowns.slices[c]
        here = slice(interior.start, pose.stop)
        out.shared[here, here] += shared.T @ shared
        out.shared_gradient[here] += shared.T @ flat
        view = seen.view[mine]
        starts = np.searchsorted(view, np.arange(views + 1))
        for v in np.unique(view):
            rows = slice(2 * starts[v], 2 * starts[v + 1])
            out.mixed[v, here] += shared[rows].T @ by_view[rows]
            out.views[v] += by_view[rows].T @ by_view[rows]
            out.view_gradients[v] += by_view[rows].T @ flat[rows]
    return out


def moved(estimate: Estimate, unknowns: Unknowns, shared: Array, views: Array) -> Estimate:
    """Returns the estimate after a step: interiors by addition, poses by left twists."""
    cameras, poses = [], []
    for c, (interior, pose) in enumerate(unknowns.slices):
        vector = vector_of(estimate.cameras[c])
        vector[unknowns.interior[c]] += shared[interior]
        cameras.append(with_vector(estimate.cameras[c], vector))
        turn = Pose.exp(shared[pose]) if unknowns.pose[c] else Pose()
        poses.append(turn @ estimate.camera_from_rig[c])
    turns = so3_exp(views[:, 3:])
    positions = (turns @ estimate.positions[..., None])[..., 0] + views[:, :3]
    return Estimate(tuple(cameras), tuple(poses), turns @ estimate.rotations, positions)
