"""Errors of consecutive blocks of samples, each aligned by itself, so that drift between blocks is no error.

The alignment is fitted in each block again; the parameters of a hypothesis are the same for all blocks. So the blocks
are nearly independent tests of it. They have several lengths: short ones show a lever arm despite drift, long ones a
clock offset on straight roads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.evaluation.audit.samples import Samples
from ispom.geometry import Array
from ispom.solvers.trajectory.alignment import umeyama

MIN_BLOCK = 16
"""Least number of samples of a block: an alignment takes up to seven numbers from their 3 x 16 coordinates."""
FEWEST_BLOCKS, MOST_BLOCKS = 4, 128
GROUPS = 8
"""Number of groups of neighbouring blocks that are held out one by one."""
POSITION_FLOOR, ROTATION_FLOOR_RAD = 1e-4, 1e-3
"""Errors below these, relative to the block's extent and in radians, count as equal: rounding in files and
interpolation cause them."""
MAX_UNDETERMINED_RAD = 0.05
"""Largest error of an alignment's rotation, from the positions' residuals and their extent across, with which
orientations are compared with those of the alignment (3 deg)."""


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors of each block."""

    position: Array
    """(B,) root mean square of the aligned positions, relative to the reference's extent in the block."""
    rotation: Array | None
    """(B,) root mean square angle [rad] after the best rotation of the world; None without rotations."""
    tied: Array | None
    """(B,) root mean square angle [rad] after the rotation of the world that the positions of the whole path determine;
    None where they do not determine it."""

    def gain(self, other: Errors) -> Array:
        """Returns (B,) logarithms of this error over the other one: of positions, and of rotations."""
        position = np.log(self.position / other.position)
        pairs = ((self.rotation, other.rotation), (self.tied, other.tied))
        turns = [np.log(a / b) for a, b in pairs if a is not None and b is not None]
        if not turns:
            return position
        # Both measure the same rotations: one with, one without their relation to the positions.
        return position + max(turns, key=lambda gain: abs(float(gain.mean())))


def levels(count: int) -> list[NDArray[np.intp]]:
    """Returns the first samples of the blocks, for each number of blocks that fits; none for a short path."""
    found, blocks = [], FEWEST_BLOCKS
    while blocks <= MOST_BLOCKS and count >= blocks * MIN_BLOCK:
        found.append(np.linspace(0, count, blocks + 1)[:-1].astype(np.intp))
        blocks *= 2
    return found


def groups_of(blocks: int) -> NDArray[np.intp]:
    """(B,) number of the group that each block belongs to."""
    return np.arange(blocks) * min(GROUPS, blocks) // blocks


def residuals(own: Array, true: Array, starts: NDArray[np.intp], with_scale: bool) -> Array:
    """Returns residuals (N, 3) of positions after each block's own alignment (Umeyama 1991, for all blocks at once)."""
    counts = np.diff(np.append(starts, len(own)))
    of_block = np.repeat(np.arange(len(starts)), counts)
    means = [np.add.reduceat(x, starts) / counts[:, None] for x in (own, true)]
    a, b = own - means[0][of_block], true - means[1][of_block]
    covariance = np.add.reduceat(b[:, :, None] * a[:, None, :], starts)
    u, singular, vt = np.linalg.svd(covariance)
    signs = np.ones((len(starts), 3))
    signs[:, 2] = np.where(np.linalg.det(u) * np.linalg.det(vt) > 0, 1.0, -1.0)
    rotation = (u * signs[:, None, :]) @ vt
    if with_scale:
        variance = np.add.reduceat((a**2).sum(axis=1), starts)
        scale = (singular * signs).sum(axis=1) / np.where(variance > 0, variance, 1.0)
        rotation = rotation * scale[:, None, None]
    return np.einsum("nij,nj->ni", rotation[of_block], a) - b


def errors(samples: Samples, starts: NDArray[np.intp], with_scale: bool, tied: bool = True) -> Errors:
    """Returns the errors of the blocks; without `tied` rotations are not compared with those that positions need."""
    counts = np.diff(np.append(starts, len(samples)))
    of_block = np.repeat(np.arange(len(starts)), counts)
    left = residuals(samples.own, samples.true, starts, with_scale)
    centred = samples.true - (np.add.reduceat(samples.true, starts) / counts[:, None])[of_block]
    squares = [np.add.reduceat((x**2).sum(axis=1), starts) / counts for x in (left, centred)]
    extent = np.sqrt(np.maximum(squares[1], 1e-30))
    position = np.hypot(np.sqrt(squares[0]) / extent, POSITION_FLOOR)
    if samples.rotations is None:
        return Errors(position, None, None)
    own, true = samples.rotations
    products = np.add.reduceat(true @ np.swapaxes(own, 1, 2), starts) / counts[:, None, None]
    u, singular, vt = np.linalg.svd(products)
    singular[:, 2] *= np.where(np.linalg.det(u) * np.linalg.det(vt) > 0, 1.0, -1.0)
    rotation = _angle(singular.sum(axis=1))
    world = world_rotation(samples, with_scale) if tied else None
    return Errors(position, rotation, None if world is None else _angle(np.einsum("ij,bij->b", world, products)))


def world_rotation(samples: Samples, with_scale: bool) -> Array | None:
    """Returns the rotation (3, 3) true_world_from_own_world that the positions determine; None where they do not."""
    onto = umeyama(samples.own, samples.true, with_scale)
    left = onto.apply(samples.own) - samples.true
    across = len(left) * np.linalg.eigvalsh(np.cov(samples.true.T, bias=True))[1]
    if across <= 0 or (left**2).sum() > MAX_UNDETERMINED_RAD**2 * across:
        return None
    return onto.pose.rotation


def _angle(trace: Array) -> Array:
    """Root mean square angles [rad] of mean traces (B,) of error rotations, with the floor."""
    angle = 2 * np.arcsin(np.sqrt(np.clip((3 - trace) / 4, 0, 1)))
    return np.hypot(angle, ROTATION_FLOOR_RAD)
