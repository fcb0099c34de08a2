"""The misfit between given poses and the images, pair by pair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, so3_log
from ispom.types import Trajectory

from .pairs import PairEvidence

STANDS = 1e-9
"""Distance between two poses, relative to the whole path, below which they have the same position."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """N pairs of frames as arrays."""

    listed: tuple[PairEvidence, ...]

    def __len__(self) -> int:
        return len(self.listed)

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """(N,)"""
        return np.array([each.first for each in self.listed], np.int64)

    @cached_property
    def second(self) -> NDArray[np.int64]:
        """(N,)"""
        return np.array([each.second for each in self.listed], np.int64)

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """(N,) whether the images show a translation."""
        return np.array([each.moves for each in self.listed], bool)

    @cached_property
    def share(self) -> Array:
        """Returns (N,) the weight of each pair, as a share of an independent pair: pairs begin at every frame, so each
        motion is in several."""
        return 1.0 / np.maximum(self.second - self.first, 1)

    @cached_property
    def rotations(self) -> Array:
        """(N, 3, 3)"""
        return np.array([each.rotation for each in self.listed]).reshape(-1, 3, 3)

    @cached_property
    def directions(self) -> Array:
        """(N, 3)"""
        return np.array([each.direction for each in self.listed]).reshape(-1, 3)

    @cached_property
    def tangents(self) -> Array:
        """(N, 2, 3)"""
        return np.array([each.tangent for each in self.listed]).reshape(-1, 2, 3)

    @cached_property
    def covariances(self) -> Array:
        """(N, 5, 5)"""
        return np.array([each.covariance for each in self.listed]).reshape(-1, 5, 5)

    @cached_property
    def whiteners(self) -> Array:
        """(N, 5, 5) L^-1 of the covariance L L^T: the first three rows whiten the rotation alone."""
        return np.linalg.inv(np.linalg.cholesky(self.covariances))

    def select(self, chosen: NDArray[np.bool_]) -> Pairs:
        """Returns some of them."""
        return Pairs(tuple(each for each, take in zip(self.listed, chosen, strict=True) if take))


@dataclass(frozen=True, eq=False)
class Misfit:
    """The misfits of N pairs."""

    vectors: Array
    """(N, 5) [rad] turn and change of direction from the images' pose to the given one; 0 for parts that are not
    compared."""
    white: Array
    """(N, 5) the same in standard deviations."""
    lengths: Array
    """(N,) distances between the given poses of each pair, in their unit."""
    directed: NDArray[np.bool_]
    """(N,) whether both the images and the given poses move, so that directions are compared."""

    @property
    def squares(self) -> Array:
        """(N,) squared Mahalanobis distances, of 5 degrees of freedom (3 where directions are not compared)."""
        return (self.white**2).sum(axis=1)

    @property
    def freedom(self) -> NDArray[np.int64]:
        """(N,)"""
        return np.where(self.directed, 5, 3)


def misfit(pairs: Pairs, given: Trajectory) -> Misfit:
    """Compares poses world_from_camera of all frames with the pairs."""
    a, b = pairs.first, pairs.second
    back = np.swapaxes(given.rotations[b], 1, 2)
    turn = so3_log(back @ given.rotations[a] @ np.swapaxes(pairs.rotations, 1, 2))
    moved = np.einsum("nij,nj->ni", back, given.translations[a] - given.translations[b])
    lengths = np.linalg.norm(moved, axis=1)
    directed = pairs.moves & (lengths > STANDS * max(given.length, 1e-300))
    unit = moved / np.maximum(lengths, 1e-300)[:, None]
    across = np.einsum("nki,ni->nk", pairs.tangents, unit)
    sine, along = np.linalg.norm(across, axis=1), (unit * pairs.directions).sum(axis=1)
    angle = np.arctan2(sine, along)
    by = np.where((sine > 1e-12)[:, None], across / np.maximum(sine, 1e-12)[:, None], np.array([1.0, 0.0]))
    vectors = np.concatenate([turn, np.where(directed[:, None], angle[:, None] * by, 0.0)], axis=1)
    white = np.einsum("nij,nj->ni", pairs.whiteners, vectors)
    white[~directed, 3:] = 0.0
    return Misfit(vectors, white, lengths, directed)
