"""The observations of a run's keyframes, as a bundle adjustment of poses, points and the method's self-calibration."""

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
ERROR_BEHIND = 1e3
"""Error [loss widths] of a point that a perturbation moves behind its camera."""


@dataclass(frozen=True)
class Adjustment:
    """The settings of a method's bundle adjustment of its keyframes."""

    sigmas: tuple[float, ...]
    """Prior standard deviations of the corrections of its camera or pair; 0 for those that it does not estimate.

    As Window.extra: of one camera (f, k), of a pair as right_camera.TERMS.
    """
    loss_px: float = 1.0
    """Width of the loss."""
    window: int = 2
    """Number of keyframes that are optimised together; those that leave the window are final."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Keyframes, points and observations."""

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
    """(N,) index of each observation's keyframe."""
    point: NDArray[np.int64]
    """(N,) index of each observation's point."""
    uv: Array
    """(N, 2) [px]."""
    right_px: Array
    """(N,) predicted column in the right image; NaN for one camera."""
    right_rate: Array
    """(N, 2) velocity of each point in the right image [1/s]; 0 for one camera."""

    @staticmethod
    def of(found: SceneMap, rig: Rig) -> Scene:
        """Returns the scene of all points in front of their cameras that at least two keyframes observe, or one of a
        pair."""
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
        right_rate = np.zeros((len(z), 2))
        if camera == "left" and rig.has_stereo:
            near = np.einsum("nij,nj->ni", rotations[view], xyz[used][point]) + translations[view]
            right_rate = drift(near, _rates(keys.times_ns, rotations, translations)[view], 0.0, rig.baseline_m)
        return Scene(
            rig=rig,
            camera=camera,
            times_ns=keys.times_ns,
            rotations=rotations,
            translations=translations,
            xyz_in_world=xyz[used],
            view=view,
            point=point,
            uv=uv,
            right_px=right,
            right_rate=right_rate,
        )

    def until(self, count: int) -> tuple[Scene, NDArray[np.bool_]]:
        """Returns the first `count` keyframes with their observations, and the mask (N,) of these observations."""
        keep = self.view < count
        if not self.is_pair:  # one view of one camera does not determine the depth
            keep &= np.bincount(self.point[keep], minlength=len(self.xyz_in_world))[self.point] >= 2
        used, point = np.unique(self.point[keep], return_inverse=True)
        part = Scene(
            rig=self.rig,
            camera=self.camera,
            times_ns=self.times_ns[:count],
            rotations=self.rotations[:count],
            translations=self.translations[:count],
            xyz_in_world=self.xyz_in_world[used],
            view=self.view[keep],
            point=point,
            uv=self.uv[keep],
            right_px=self.right_px[keep],
            right_rate=self.right_rate[keep],
        )
        return part, keep

    @property
    def is_pair(self) -> bool:
        return self.camera == "left" and self.rig.has_stereo

    def in_camera(self, rotations: Array, translations: Array, xyz_in_world: Array) -> Array:
        """Returns each observation's point in its camera (N, 3)."""
        return np.einsum("nij,nj->ni", rotations[self.view], xyz_in_world[self.point]) + translations[self.view]

    def errors(self, in_camera: Array, extra: Array, perturbation: Perturbation) -> Array:
        """Returns predicted minus observed x, y (N, 2), of a pair x, y and right x (N, 3), normalised and perturbed.

        `extra` (E,) as in Adjustment; ERROR_BEHIND for a point that is not before its camera.
        """
        rig = perturbation.of_rig(self.rig)
        seen = rig.camera(self.camera).normalise(self.uv)
        z = np.where(in_camera[:, 2] > MIN_DEPTH, in_camera[:, 2], np.nan)
        xy = in_camera[:, :2] / z[:, None]
        if not self.is_pair:
            stretch = 1 + extra @ np.stack([np.ones(len(z)), (xy**2).sum(1)])
            return np.nan_to_num(xy * stretch[:, None] - seen, nan=ERROR_BEHIND)
        x, square = xy[:, 0] - rig.baseline_m / z, (xy**2).sum(1)
        xy = xy * (1 + extra[:BOTH] @ np.stack([square, square**2]))[:, None]
        camera = rig.camera("left")
        seen_right = (self.right_px - camera.cx) / camera.fx
        offset = by_column(*self._right(in_camera), self.right_rate) @ extra[:COLUMNS]
        return np.nan_to_num(np.column_stack([xy - seen, x + offset - seen_right]), nan=ERROR_BEHIND)

    def by_point(self, in_camera: Array) -> Array:
        """Returns the derivative (N, 2 or 3, 3) of the errors by the point in its camera, without corrections."""
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
        """Returns the derivative (N, 2 or 3, E) of the errors by the corrections, at zero."""
        xy = in_camera[:, :2] / in_camera[:, 2:]
        if not self.is_pair:
            return np.stack([xy, xy * (xy**2).sum(1, keepdims=True)], axis=2)
        columns = by_column(*self._right(in_camera), self.right_rate)
        out, square = np.zeros((len(columns), 3, PAIR)), (xy**2).sum(1)
        out[:, 2, :COLUMNS] = columns
        for power in range(BOTH):
            out[:, :2, power] = xy * square[:, None] ** (power + 1)
        return out

    def row_information(self, rotations: Array, translations: Array, xyz_in_world: Array) -> Array:
        """Returns the information (E, E) of a pair's rows on its corrections, at unit noise; 0 for one camera."""
        if not self.is_pair:
            return np.zeros((LENS, LENS))
        rows = by_row(*self._right(self.in_camera(rotations, translations, xyz_in_world)), self.right_rate)
        return rows.T @ rows

    def _right(self, in_camera: Array) -> tuple[Array, Array]:
        """Returns positions (N, 2) in the right image, normalised, and disparities (N,)."""
        disparity = self.rig.baseline_m / np.maximum(in_camera[:, 2], MIN_DEPTH)
        right = in_camera[:, :2] / np.maximum(in_camera[:, 2:], MIN_DEPTH)
        right[:, 0] -= disparity
        return right, disparity


def _rates(times_ns: NDArray[np.int64], rotations: Array, translations: Array) -> Array:
    """Returns velocities (K, 6) of camera_from_world (rho [m/s], phi [rad/s]; left), by the neighbouring keyframes."""
    last = len(times_ns) - 1
    out = np.zeros((last + 1, 6))
    for k in range(last + 1):
        before, after = max(k - 1, 0), min(k + 1, last)
        moved = Pose(rotations[after], translations[after]) @ Pose(rotations[before], translations[before]).inverse()
        out[k] = moved.log() / max((times_ns[after] - times_ns[before]) * 1e-9, 1e-9)
    return out
