"""Rigid motions: `Pose` and the maps between rotation vectors, rotations and twists.

Convention: a pose is named `target_from_source` and maps points, x_target = R x_source + t.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

Array = NDArray[np.floating[Any]]


def skew(v: Array) -> Array:
    """The (..., 3, 3) matrices with skew(v) @ x == cross(v, x), of v (..., 3)."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def so3_exp(rotvec_rad: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad] (Rodrigues)."""
    rotvec = np.asarray(rotvec_rad, float)
    angle = np.sqrt((rotvec * rotvec).sum(-1))[..., None, None]
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    versine = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    k = skew(rotvec)
    return np.eye(3) + sine * k + versine * (k @ k)


def so3_log(rotation: Array) -> Array:
    """Rotation vectors (..., 3) [rad], of length 0..pi, of rotation matrices (..., 3, 3)."""
    rotation = np.asarray(rotation, float)
    return Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec().reshape(*rotation.shape[:-2], 3)


def so3_left_jacobian(rotvec_rad: Array) -> Array:
    """The (3, 3) matrix V with se3_exp((rho, phi)).t == V @ rho (Barfoot, State Estimation for Robotics, 7.1)."""
    theta = float(np.linalg.norm(rotvec_rad))
    k = skew(rotvec_rad)
    if theta < 1e-5:
        return np.eye(3) + k / 2 + k @ k / 6
    return np.eye(3) + (1 - np.cos(theta)) / theta**2 * k + (theta - np.sin(theta)) / theta**3 * k @ k


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion `target_from_source`."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) target_from_source rotation."""
    translation: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) origin of source in target [m, or the unit of the trajectory]."""

    def __post_init__(self) -> None:
        rotation, translation = np.array(self.rotation, float), np.array(self.translation, float)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise ValueError(f"a pose is (3, 3) and (3,), not {rotation.shape} and {translation.shape}")
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @staticmethod
    def from_matrix(matrix: Array) -> Pose:
        """From a (4, 4) or (3, 4) homogeneous matrix."""
        return Pose(matrix[:3, :3], matrix[:3, 3])

    @staticmethod
    def from_rotvec(rotvec_rad: Array, translation: Array) -> Pose:
        """From a rotation vector (3,) [rad] and a translation (3,): also what OpenCV calls rvec and tvec."""
        return Pose(so3_exp(np.ravel(rotvec_rad)), np.ravel(translation))

    @staticmethod
    def from_xyzw(quaternion_xyzw: Array, translation: Array) -> Pose:
        """From a quaternion (4,) in x, y, z, w order (scipy, TUM, Rerun), normalised here."""
        return Pose(Rotation.from_quat(quaternion_xyzw).as_matrix(), translation)

    @staticmethod
    def exp(twist: Array) -> Pose:
        """se(3) -> SE(3); twist (6,) = (rho [m], phi [rad])."""
        return Pose(so3_exp(twist[3:]), so3_left_jacobian(twist[3:]) @ twist[:3])

    def log(self) -> Array:
        """SE(3) -> se(3): (6,) = (rho [m], phi [rad]), the inverse of `exp` for angles below pi."""
        phi = so3_log(self.rotation)
        return np.concatenate([np.linalg.solve(so3_left_jacobian(phi), self.translation), phi])

    @property
    def matrix(self) -> Array:
        """(4, 4) homogeneous matrix."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.rotation, self.translation
        return out

    @property
    def xyzw(self) -> Array:
        """Quaternion (4,) in x, y, z, w order, w >= 0 (scipy, TUM, Rerun)."""
        return Rotation.from_matrix(self.rotation).as_quat(canonical=True)

    @property
    def wxyz(self) -> Array:
        """Quaternion (4,) in w, x, y, z order, w >= 0 (viser)."""
        return self.xyzw[[3, 0, 1, 2]]

    @property
    def rotvec(self) -> Array:
        """Rotation vector (3,) [rad] (OpenCV's rvec)."""
        return so3_log(self.rotation)

    def __matmul__(self, other: Pose) -> Pose:
        """a_from_b @ b_from_c == a_from_c."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, xyz_in_source: Array) -> Array:
        """Points (..., 3) of source, in target."""
        return xyz_in_source @ self.rotation.T + self.translation

    @property
    def adjoint(self) -> Array:
        """(6, 6) with self @ exp(twist) == exp(adjoint @ twist) @ self, twist = (rho, phi)."""
        out = np.zeros((6, 6))
        out[:3, :3] = out[3:, 3:] = self.rotation
        out[:3, 3:] = skew(self.translation) @ self.rotation
        return out

    def scaled(self, factor: float) -> Pose:
        """The same motion with its translation in another unit."""
        return Pose(self.rotation, factor * self.translation)


@dataclass(frozen=True, eq=False)
class Similarity:
    """A change of unit and frame, x_target = scale R x_source + t: how a trajectory without metric scale is placed."""

    scale: float = 1.0
    """Target units per source unit, > 0."""
    pose: Pose = field(default_factory=Pose)
    """target_from_source, in target units."""

    def apply(self, xyz_in_source: Array) -> Array:
        """Points (..., 3) of source, in target."""
        return self.pose.apply(self.scale * xyz_in_source)

    def apply_pose(self, source_from_frame: Pose) -> Pose:
        """target_from_frame of a source_from_frame."""
        return self.pose @ source_from_frame.scaled(self.scale)

    def __matmul__(self, other: Similarity) -> Similarity:
        """a_from_b @ b_from_c == a_from_c."""
        return Similarity(self.scale * other.scale, self.apply_pose(other.pose))

    def inverse(self) -> Similarity:
        return Similarity(1 / self.scale, self.pose.inverse().scaled(1 / self.scale))


def slerp(start: Array, end: Array, fraction: Array) -> Array:
    """Rotations (N, 3, 3) at constant angular velocity between two (3, 3), at fractions (N,) in 0..1."""
    return Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([start, end])))(np.clip(fraction, 0, 1)).as_matrix()


def rotation_angle_rad(rotation: Array) -> Array:
    """Angles (...) [rad], 0..pi, of rotations (..., 3, 3)."""
    r = np.asarray(rotation, float)
    x, y, z = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    # twice its sine, and twice its cosine: exact at both ends, where either alone is not
    return np.arctan2(np.sqrt(x * x + y * y + z * z), r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2] - 1)


def rotation_between(a: Array, b: Array) -> Array:
    """The smallest rotation (3, 3) that turns the direction of a (3,) into that of b (3,); lengths do not matter.

    Opposite vectors turn by pi about an arbitrary perpendicular axis. Raises ValueError where one has no length.
    """
    norm_a, norm_b = np.linalg.norm(a), np.linalg.norm(b)
    if norm_a == 0 or norm_b == 0:
        raise ValueError("a vector of length zero has no direction")
    a, b = a / norm_a, b / norm_b
    axis = np.asarray(np.cross(a, b), float)
    sine, cosine = np.linalg.norm(axis), float(a @ b)
    if sine < 1e-12:
        if cosine > 0:
            return np.eye(3)
        axis = np.asarray(np.cross(a, np.eye(3)[np.argmin(np.abs(a))]), float)
        return so3_exp(axis * (np.pi / float(np.linalg.norm(axis))))
    return so3_exp(axis * (float(np.arctan2(sine, cosine)) / float(sine)))
