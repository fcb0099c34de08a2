"""The derivatives of poses by a small error of the calibration: one Gauss-Newton step of the bundle adjustment.

Poses, points and the method's own corrections are at their optimum in the run. There, by the implicit function
theorem, they move by -H^-1 J' W d(errors)/d(calibration), H = J' W J; points are eliminated (Triggs et al. 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from ispom.evaluation.sensitivity.scene import Adjustment, Scene
from ispom.geometry import Array, Pose, skew

GAUGE_OF_PARTS = 1e-4
"""Information of the weak prior that keyframes without common points move together [1/scale^2 of the loss, over 1 m and
1 rad]."""
GAUGE_INFORMATION = 1e8
"""Information of the prior that fixes the gauge: the origin of the world and, for one camera, the scale."""
RIDGE = 1e-9
"""Damping of a point observed without parallax, as a share of its largest information."""


@dataclass(frozen=True, eq=False)
class Values:
    """The parameters of the adjustment."""

    rotations: Array
    """(K, 3, 3) camera_from_world."""
    translations: Array
    """(K, 3)."""
    xyz_in_world: Array
    """(M, 3)."""
    extra: Array
    """(E,)."""

    @property
    def positions(self) -> Array:
        """Returns the positions (K, 3) of the cameras in the world."""
        return -np.einsum("kji,kj->ki", self.rotations, self.translations)

    def moved(self, poses: Array, points: Array, extra: Array) -> Values:
        """Applies twists (K, 6) of the cameras in the world, steps (M, 3) of the points, and changes (E,)."""
        back = [Pose.exp(-twist) for twist in poses]
        rotations = self.rotations @ np.stack([pose.rotation for pose in back])
        away = np.stack([pose.translation for pose in back])
        translations = np.einsum("kij,kj->ki", self.rotations, away) + self.translations
        return Values(rotations, translations, self.xyz_in_world + points, self.extra + extra)


@dataclass(frozen=True, eq=False)
class Steps:
    """Solutions for P right-hand sides."""

    poses: Array
    """(K, 6, P)."""
    points: Array
    """(M, 3, P)."""
    extra: Array
    """(E, P)."""


def start(scene: Scene, adjustment: Adjustment) -> Values:
    """Returns the result of the run."""
    extra = np.zeros(len(adjustment.sigmas))
    return Values(scene.rotations, scene.translations, scene.xyz_in_world, extra)


def solve(scene: Scene, values: Values, adjustment: Adjustment, errors: Array, sides: Array) -> Steps:
    """Returns -H^-1 J' W side for right-hand sides (N, 2 or 3, P), linearised at `values` with errors `errors`.

    The first keyframe is fixed and, with one camera, the distance to the last one of the first window: the scale.
    """
    q = scene.in_camera(values.rotations, values.translations, values.xyz_in_world)
    per = (scene.rig.camera(scene.camera).fx / adjustment.loss_px) ** 2
    root = np.sqrt(per / (1 + (errors**2).sum(1) * per))[:, None, None]
    rotations = values.rotations[scene.view]
    by_point = root * (scene.by_point(q) @ rotations)
    xyz = values.xyz_in_world[scene.point]
    by_pose = np.concatenate([-by_point, by_point @ _skews(xyz)], axis=2)
    free = np.array(adjustment.sigmas) > 0
    by_extra = root * scene.by_extra(q) * free
    count, points = len(scene.times_ns), len(values.xyz_in_world)
    of_poses = _blocks(by_pose, scene.view, count)
    of_rest = sparse.csr_array(by_extra.reshape(-1, len(free)))
    jacobian = sparse.hstack([of_poses, of_rest], format="csr")
    of_points = _blocks(by_point, scene.point, points)
    information = np.zeros((points, 3, 3))
    np.add.at(information, scene.point, np.swapaxes(by_point, 1, 2) @ by_point)
    information += (RIDGE * np.trace(information, axis1=1, axis2=2) + 1e-12)[:, None, None] * np.eye(3)
    inverse = sparse.bsr_array(
        (np.linalg.inv(information), np.arange(points), np.arange(points + 1)), shape=(3 * points, 3 * points)
    )
    mixed = jacobian.T @ of_points
    side = (root * sides).reshape(-1, sides.shape[2])
    reduced = jacobian.T @ jacobian - mixed @ inverse @ mixed.T + _prior(scene, values, adjustment)
    right = jacobian.T @ side - mixed @ (inverse @ (of_points.T @ side))
    right[6 * count :] += (_information(scene, values, adjustment) @ values.extra)[:, None]
    step = -splu(sparse.csc_array(reduced)).solve(right)
    shift = -(inverse @ (of_points.T @ side + mixed.T @ step))
    cut, p = 6 * count, sides.shape[2]
    return Steps(step[:cut].reshape(count, 6, p), shift.reshape(points, 3, p), step[cut:])


def _prior(scene: Scene, values: Values, adjustment: Adjustment) -> sparse.csr_array:
    """Returns the prior on the gauge and on the corrections."""
    count = len(scene.times_ns)
    chain = sparse.eye_array(count - 1, count) - sparse.eye_array(count - 1, count, k=1)
    joined = GAUGE_OF_PARTS * sparse.kron(chain.T @ chain, sparse.eye_array(6))
    fixed = sparse.lil_array((6 * count, 6 * count))
    fixed[:6, :6] = GAUGE_INFORMATION * np.eye(6)
    if not scene.is_pair:
        positions = values.positions
        far = min(adjustment.window, count) - 1
        away = positions[far] - positions[0]
        way = away / max(float((away**2).sum()), 1e-12)
        row = np.concatenate([way, np.cross(positions[far], way)])
        fixed[6 * far : 6 * far + 6, 6 * far : 6 * far + 6] += GAUGE_INFORMATION * np.outer(row, row)
    return sparse.csr_array(sparse.block_diag([joined + fixed, _information(scene, values, adjustment)]))


def _information(scene: Scene, values: Values, adjustment: Adjustment) -> Array:
    """Returns the information (E, E) of the corrections from their prior and a pair's rows; 1 where fixed."""
    sigmas, per = np.array(adjustment.sigmas), scene.rig.camera(scene.camera).fx / adjustment.loss_px
    rows = per**2 * scene.row_information(values.rotations, values.translations, values.xyz_in_world)
    free = sigmas > 0
    return np.diag(np.where(free, sigmas, 1.0) ** -2.0) + rows * np.outer(free, free)


def _blocks(values: Array, column: NDArray[np.int64], count: int) -> sparse.csr_array:
    """Places the block (R, C) of each observation (N, R, C) in its block column."""
    n, rows, width = values.shape
    index = np.arange(n * rows).reshape(n, rows, 1), (width * column)[:, None, None] + np.arange(width)
    where = [np.broadcast_to(each, values.shape).ravel() for each in index]
    return sparse.csr_array((values.ravel(), (where[0], where[1])), shape=(n * rows, width * count))


def _skews(xyz: Array) -> Array:
    """Returns (N, 3, 3) [x]x."""
    out = np.zeros((len(xyz), 3, 3))
    for i, axis in enumerate(np.eye(3)):
        out += xyz[:, i, None, None] * skew(axis)
    return out
