"""What the key frames of a run saw: a problem of poses, points, and what the method itself corrects in its cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.geometry import Array, Pose
from ispom.io.maps import SceneMap
from ispom.solvers.right_camera import BOTH, COLUMNS, PAIR, by_column, by_row, drift
from ispom.solvers.window.prior import LENS
from ispom.types import FrameName, Rig

MIN_DEPTH = 1e-6
GROSS = 1e3
"""Error [scales] of a point that a change puts behind its camera."""


@dataclass(frozen=True)
class Adjustment:
    """How a method adjusts what its key frames saw."""

    sigmas: tuple[float, ...]
    """What it corrects in its camera or pair, standard deviations before any data; 0 for what it does not.

    As Window.extra: of one camera (f, k), of a pair as right_camera.TERMS.
    """
    loss_px: float = 1.0
    """Scale of the loss, in the units of which `sigmas` are."""
    window: int = 2
    """Key frames that are adjusted together: what leaves them is settled, and what is learned later is late for it."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Key frames, points, and where the one saw the other."""

    rig: Rig
    camera: FrameName
    """video, or left for the pair."""
    times_ns: NDArray[np.int64]
    """(K,)."""
    rotations: Array
    """(K, 3, 3) camera_from_world."""
    translations: Array
    """(K, 3)."""
    xyz_in_world: Array
    """(M, 3)."""
    view: NDArray[np.int64]
    """(N,) the key frame of each observation."""
    point: NDArray[np.int64]
    """(N,) its point."""
    uv: Array
    """(N, 2) [px]."""
    right_px: Array
    """(N,) column in the right image, where the points are taken to be seen there; NaN for one camera."""
    late: Array
    """(N, 2) how fast each point moves in the right image [1/s]; 0 for one camera."""

    @staticmethod
    def of(found: SceneMap, rig: Rig) -> Scene:
        """All that is seen in two key frames at least (of a pair, in one) and before its camera."""
        keys, camera = found.key_frames, found.key_frames.frame
        order = np.argsort(found.landmarks.ids, kind="stable")
        ids, xyz = found.landmarks.ids[order], found.landmarks.xyz_in_world[order].astype(float)
        at = np.searchsorted(ids, found.seen_ids).clip(0, max(len(ids) - 1, 0))
        known = ids[at] == found.seen_ids if len(ids) else np.zeros(len(at), bool)
        rotations = np.swapaxes(keys.rotations, 1, 2)
        translations = -np.einsum("kij,kj->ki", rotations, keys.translations)
        view, point, uv = found.seen_from[known], at[known], found.seen_uv[known].astype(float)
        z = np.einsum("ni,ni->n", rotations[view, 2], xyz[point]) + translations[view, 2]
        often = np.bincount(point[z > MIN_DEPTH], minlength=len(ids)) >= (1 if camera == "left" else 2)
        good = (z > MIN_DEPTH) & often[point]
        used, point = np.unique(point[good], return_inverse=True)
        view, uv, z = view[good], uv[good], z[good]
        right = np.full(len(z), np.nan)
        if camera == "left" and rig.has_stereo:
            right = uv[:, 0] - rig.camera("left").fx * rig.baseline_m / z
        late = np.zeros((len(z), 2))
        if camera == "left" and rig.has_stereo:
            near = np.einsum("nij,nj->ni", rotations[view], xyz[used][point]) + translations[view]
            late = drift(near, _rates(keys.times_ns, rotations, translations)[view], 0.0, rig.baseline_m)
        return Scene(rig, camera, keys.times_ns, rotations, translations, xyz[used], view, point, uv, right, late)

    def until(self, count: int) -> tuple[Scene, NDArray[np.bool_]]:
        """The first `count` key frames with what they saw, and which observations (N,) that is."""
        keep = self.view < count
        if not self.is_pair:  # one view of one camera says nothing
            keep &= np.bincount(self.point[keep], minlength=len(self.xyz_in_world))[self.point] >= 2
        used, point = np.unique(self.point[keep], return_inverse=True)
        part = Scene(
            self.rig, self.camera, self.times_ns[:count], self.rotations[:count], self.translations[:count],
            self.xyz_in_world[used], self.view[keep], point, self.uv[keep], self.right_px[keep], self.late[keep],
        )  # fmt: skip
        return part, keep

    @property
    def is_pair(self) -> bool:
        return self.camera == "left" and self.rig.has_stereo

    def in_camera(self, rotations: Array, translations: Array, xyz_in_world: Array) -> Array:
        """(N, 3) of each observation its point in its camera."""
        return np.einsum("nij,nj->ni", rotations[self.view], xyz_in_world[self.point]) + translations[self.view]

    def errors(self, in_camera: Array, extra: Array, wrong: Perturbation) -> Array:
        """(N, 2), of a pair (N, 3): predicted minus seen x, y and right x, normalised, with a wrong calibration.

        `extra` (E,) as in Adjustment; GROSS for a point that is not before its camera.
        """
        rig = wrong.of_rig(self.rig)
        seen = rig.camera(self.camera).normalise(self.uv)
        z = np.where(in_camera[:, 2] > MIN_DEPTH, in_camera[:, 2], np.nan)
        xy = in_camera[:, :2] / z[:, None]
        if not self.is_pair:
            stretch = 1 + extra @ np.stack([np.ones(len(z)), (xy**2).sum(1)])
            return np.nan_to_num(xy * stretch[:, None] - seen, nan=GROSS)
        x, square = xy[:, 0] - rig.baseline_m / z, (xy**2).sum(1)
        xy = xy * (1 + extra[:BOTH] @ np.stack([square, square**2]))[:, None]
        camera = rig.camera("left")
        seen_right = (self.right_px - camera.cx) / camera.fx
        offset = by_column(*self._right(in_camera), self.late) @ extra[:COLUMNS]
        return np.nan_to_num(np.column_stack([xy - seen, x + offset - seen_right]), nan=GROSS)

    def by_point(self, in_camera: Array) -> Array:
        """(N, 2 or 3, 3) how the errors change with the point in its camera; without corrections."""
        iz = 1 / in_camera[:, 2]
        columns = [in_camera[:, 0] * iz, in_camera[:, 1] * iz]
        if self.is_pair:
            columns.append(columns[0] - self.rig.baseline_m * iz)
        out = np.zeros((len(iz), len(columns), 3))
        for row, (value, axis) in enumerate(zip(columns, (0, 1, 0), strict=False)):
            out[:, row, axis] = iz
            out[:, row, 2] = -value * iz
        return out

    def by_extra(self, in_camera: Array) -> Array:
        """(N, 2 or 3, E) how the errors change with the corrections, at none."""
        xy = in_camera[:, :2] / in_camera[:, 2:]
        if not self.is_pair:
            return np.stack([xy, xy * (xy**2).sum(1, keepdims=True)], axis=2)
        columns = by_column(*self._right(in_camera), self.late)
        out, square = np.zeros((len(columns), 3, PAIR)), (xy**2).sum(1)
        out[:, 2, :COLUMNS] = columns
        for power in range(BOTH):
            out[:, :2, power] = xy * square[:, None] ** (power + 1)
        return out

    def row_information(self, rotations: Array, translations: Array, xyz_in_world: Array) -> Array:
        """(E, E) what rows of a pair say of its corrections, by observations of unit deviation; 0 for one camera."""
        if not self.is_pair:
            return np.zeros((LENS, LENS))
        rows = by_row(*self._right(self.in_camera(rotations, translations, xyz_in_world)), self.late)
        return rows.T @ rows

    def _right(self, in_camera: Array) -> tuple[Array, Array]:
        """Places (N, 2) in the right image, normalised, and disparities (N,)."""
        disparity = self.rig.baseline_m / np.maximum(in_camera[:, 2], MIN_DEPTH)
        right = in_camera[:, :2] / np.maximum(in_camera[:, 2:], MIN_DEPTH)
        right[:, 0] -= disparity
        return right, disparity


def _rates(times_ns: NDArray[np.int64], rotations: Array, translations: Array) -> Array:
    """(K, 6) change of camera_from_world (rho [m/s], phi [rad/s]; left), from the key frame before to the one after."""
    last = len(times_ns) - 1
    out = np.zeros((last + 1, 6))
    for k in range(last + 1):
        before, after = max(k - 1, 0), min(k + 1, last)
        moved = Pose(rotations[after], translations[after]) @ Pose(rotations[before], translations[before]).inverse()
        out[k] = moved.log() / max((times_ns[after] - times_ns[before]) * 1e-9, 1e-9)
    return out
