"""The influence of tracks, and of the predicted motion, on a pose that was localised by known points.

As in `window`: a track is left out by one Newton step of the remaining problem, with the loss's own curvature, and
several parts by repeated steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.numerics.twist import twist_of
from ispom.solvers.epipolar import Rays
from ispom.solvers.influence.problem import Part, Shift
from ispom.solvers.localisation import MIN_POINTS
from ispom.solvers.window.covariance import inverse_curvature
from ispom.types import FrameName

MAX_STEPS, CONVERGED_STEP = 100, 1e-9
"""Largest number of steps of `really`, and the size of the step that ends them [rad, median depths]."""
MOTION, OPEN_TRACKS = "motion before", "tracks without a point"


@dataclass(frozen=True, eq=False)
class ResectionProblem:
    """A pose that was localised by points of the map."""

    ids: NDArray[np.int64]
    """(N,) ids of the tracks, ascending."""
    xyz: Array
    """(N, 3) points, which are fixed."""
    observed: Array
    """(N, 3) normalised x, y, and right x, NaN where there is none; or (N, 2)."""
    camera_from_world: Pose
    """The estimated pose."""
    scale: float
    """Width of the loss, normalised."""
    frame: FrameName
    baseline: float = 0.0
    guess: Pose | None = None
    information: Array | None = None
    """(6, 6) information of the guess, if it is a prior."""
    rays: Rays | None = None
    """Tracks without a point, which also contribute."""

    @property
    def pose(self) -> Pose:
        return self.camera_from_world.inverse()

    @property
    def parts(self) -> tuple[Part, ...]:
        tracks = [Part("track", tracks=(int(i),)) for i in self.ids]
        priors = [MOTION] * (self.information is not None) + [OPEN_TRACKS] * (self.rays is not None)
        return (*tracks, *(Part("prior", name) for name in priors))

    def shifts(self, parts: tuple[Part, ...]) -> list[Shift]:
        terms = self._terms(self.camera_from_world)
        rest = terms.step(np.ones(len(self.ids), bool), frozenset())
        return [self._shift(terms, part, rest) if part.kind == "track" else self.really(part) for part in parts]

    def really(self, part: Part) -> Shift:
        keep, without = self._left(part)
        if keep.sum() < MIN_POINTS:
            return Shift.unknown()
        whole, found = (
            self._solved(k, w).inverse() for k, w in ((np.ones(len(keep), bool), frozenset[str]()), (keep, without))
        )
        return Shift(whole.translation - found.translation, twist_of(whole.inverse() @ found)[3:])

    def seen(self) -> tuple[NDArray[np.int64], Array]:
        return self.ids, self.observed[:, :2]

    def _left(self, part: Part) -> tuple[NDArray[np.bool_], frozenset[str]]:
        without = frozenset({part.name} if part.kind == "prior" else ())
        return ~np.isin(self.ids, np.array(part.tracks, np.int64)), without

    def _shift(self, terms: Terms, part: Part, rest: Array) -> Shift:
        keep, without = self._left(part)
        if keep.sum() < MIN_POINTS:
            return Shift.unknown()
        return Shift.of_twist(self.pose, rest - terms.step(keep, without))

    def _solved(self, keep: NDArray[np.bool_], without: frozenset[str]) -> Pose:
        """Solves the remaining problem by reweighted steps from the estimated pose."""
        pose, depth = self.camera_from_world, float(np.median(self.camera_from_world.apply(self.xyz)[:, 2]))
        for _ in range(MAX_STEPS):
            step = self._terms(pose).step(keep, without, own=False)
            pose = Pose.exp(step) @ pose
            if np.abs(step[:3]).max() < CONVERGED_STEP * abs(depth) and np.abs(step[3:]).max() < CONVERGED_STEP:
                break
        return pose

    def _terms(self, camera_from_world: Pose) -> Terms:
        near = camera_from_world.apply(self.xyz)
        front = near[:, 2] > 1e-6
        x, y, iz = (np.where(front, v, 0.0) for v in _projected(near, front))
        zero, one = np.zeros(len(near)), front.astype(float)
        by_point = [np.stack([iz, zero, -x * iz], 1), np.stack([zero, iz, -y * iz], 1)]
        errors = [x - self.observed[:, 0] * one, y - self.observed[:, 1] * one]
        if self.observed.shape[1] == 3:
            paired = np.isfinite(self.observed[:, 2]) & front
            right = x - self.baseline * iz
            by_point.append(np.where(paired[:, None], np.stack([iz, zero, -right * iz], 1), 0.0))
            errors.append(np.where(paired, right - np.where(paired, self.observed[:, 2], 0.0), 0.0))
        e, j = np.stack(errors, 1) / self.scale, np.stack(by_point, 1) / self.scale
        rows = np.concatenate([j, np.cross(near[:, None], j)], axis=2)
        weights = one / (1 + (e**2).sum(axis=1))
        gradients = np.einsum("n,nr,nri->ni", weights, e, rows)
        fixed = np.einsum("n,nri,nrj->nij", weights, rows, rows)
        held = dict[str, tuple[Array, Array]]()
        if self.information is not None and self.guess is not None:
            since = twist_of(camera_from_world @ self.guess.inverse())
            held[MOTION] = self.information, self.information @ since
        if self.rays is not None:
            held[OPEN_TRACKS] = self.rays.normal(camera_from_world, self.scale)
        return Terms(gradients, fixed, fixed - 2 * gradients[:, :, None] * gradients[:, None, :], held)


@dataclass(frozen=True, eq=False)
class Terms:
    """The normal equations of a pose, by part."""

    gradients: Array
    """(N, 6) gradient of each point."""
    fixed: Array
    """(N, 6, 6) second derivatives with fixed weights."""
    own: Array
    """(N, 6, 6) second derivatives of the loss itself."""
    held: dict[str, tuple[Array, Array]]
    """Information (6, 6) and gradient (6,) of each prior."""

    def step(self, keep: NDArray[np.bool_], without: frozenset[str], own: bool = True) -> Array:
        """Returns the left twist (6,) to the minimum of the remaining parts."""
        held = [terms for name, terms in self.held.items() if name not in without]
        information = sum((h for h, _ in held), np.zeros((6, 6)))
        gradient = self.gradients[keep].sum(axis=0) + sum((g for _, g in held), np.zeros(6))
        fixed = self.fixed[keep].sum(axis=0) + information
        curvature = self.own[keep].sum(axis=0) + information if own else fixed
        return -inverse_curvature(curvature, fixed) @ gradient


def _projected(near: Array, front: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    iz = 1 / np.where(front, near[:, 2], 1.0)
    return near[:, 0] * iz, near[:, 1] * iz, iz
