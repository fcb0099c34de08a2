"""The problem that is optimised in a window: poses, points and observations, and all terms of its cost.

The image points are the residual family with a compiled fast path (`kernels`). All else is in `Window.terms`: the prior
from marginalisation or that of the calibration, and the families of `Window.families`. Cost, normal equations,
marginalisation, covariance and influence take this list, so a new term is one class (see `PoseFamily`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.geometry import Array
from ispom.solvers.least_squares import Family, Problem, cost, normal_equations
from ispom.solvers.right_camera import without_lens
from ispom.solvers.window.observation import Observed, squared_errors
from ispom.solvers.window.prior import LENS, POSE, Prior, Sandwich


class Term(Protocol):
    """A part of a window's cost that depends on its poses and corrections only, D = 6 C + E unknowns."""

    @property
    def name(self) -> str:
        """What it is called where its influence is reported."""
        ...

    def cost(self, window: Window) -> float:
        """Returns the cost at the values of the window."""
        ...

    def add(self, window: Window, matrix: Array, right: Array) -> None:
        """Adds its second derivatives to `matrix` (D, D) and its negative gradient to `right` (D,)."""
        ...

    def add_sandwich(self, window: Window, curvature: Array, scatter: Array) -> None:
        """Adds to the parts of the covariance (see prior.Sandwich).

        `scatter` (D, D) gets the covariance of the gradient. `curvature` (D, D) contains the second derivatives of
        `add` already, and gets their difference from those of the loss itself.
        """
        ...


class PoseFamily(Family["Window"]):
    """Residuals of one kind over the poses and corrections of a window: a frozen dataclass with a field `widths`.

    The shared unknowns are the left twists of the poses (6 C) and the corrections (E). A residual that depends on the
    oldest pose is marginalised with it. Covariances are multiplied by the `variance` of the image points' noise,
    relative to the squared loss width, so `widths` (K,) are standard deviations over its square root.
    """

    name: str
    variance: float

    def cost(self, window: Window) -> float:
        return cost(_alone(self, window), window)

    def add(self, window: Window, matrix: Array, right: Array) -> None:
        equations = normal_equations(_alone(self, window), window)
        matrix += equations.shared
        right -= equations.shared_gradient

    def add_sandwich(self, window: Window, curvature: Array, scatter: Array) -> None:
        scatter += self.variance * normal_equations(_alone(self, window), window).shared

    def of_first_pose(self, window: Window) -> PoseFamily:
        """Returns the family with the residuals only that depend on the first pose of the window."""
        columns = self.derivatives(window).columns
        is_first = ((columns >= 0) & (columns < POSE)).any(axis=1)
        return replace(self, widths=np.where(is_first, self.widths, np.inf))  # type: ignore[type-var]


def _alone(family: PoseFamily, window: Window) -> Problem[Window]:
    size = POSE * len(window.rotations) + len(window.extra)
    return Problem((family,), lambda values, shared, blocks: values, size)


@dataclass(frozen=True, eq=False)
class MarginalPrior:
    """The prior from marginalised poses and points, as a term."""

    prior: Prior
    name = "earlier keyframes"

    def cost(self, window: Window) -> float:
        return self.prior.cost(window.shift)

    def add(self, window: Window, matrix: Array, right: Array) -> None:
        hessian, p, first = self.prior.hessian, POSE * len(self.prior.rotations), POSE * len(window.rotations)
        gradient = self.prior.gradient + hessian @ window.shift
        matrix[:p, :p] += hessian[:p, :p]
        matrix[first:, :p] += hessian[p:, :p]
        matrix[:p, first:] += hessian[:p, p:]
        matrix[first:, first:] += hessian[p:, p:]
        right[:p] -= gradient[:p]
        right[first:] -= gradient[p:]

    def add_sandwich(self, window: Window, curvature: Array, scatter: Array) -> None:
        prior, first = self.prior, POSE * len(window.rotations)
        poses, corrections = np.arange(POSE * len(prior.rotations)), np.arange(first, first + len(window.extra))
        unknowns = np.concatenate([poses, corrections])
        at = np.ix_(unknowns, unknowns)
        sandwich = prior.sandwich or Sandwich(prior.hessian, prior.hessian)
        curvature[at] += sandwich.curvature - prior.hessian
        scatter[at] += sandwich.scatter


class CalibrationPrior:
    """The prior of the corrections by their standard deviations, where no pose was marginalised, as a term."""

    name = "calibration"

    def cost(self, window: Window) -> float:
        free = window.extra_sigma > 0
        return 0.5 * float(((window.extra[free] / window.extra_sigma[free]) ** 2).sum())

    def add(self, window: Window, matrix: Array, right: Array) -> None:
        first = POSE * len(window.rotations)
        for i in np.flatnonzero(window.extra_sigma > 0):
            sigma = window.extra_sigma[i]
            matrix[first + i, first + i] += sigma**-2
            right[first + i] -= window.extra[i] / sigma**2

    def add_sandwich(self, window: Window, curvature: Array, scatter: Array) -> None:
        """Adds nothing: covariances that use a sandwich have a marginal prior."""


@dataclass(frozen=True, eq=False)
class Window:
    """Poses, points and observations to optimise. Image coordinates are normalised (on the plane z = 1)."""

    rotations: Array
    """(C, 3, 3) camera_from_world, oldest first."""
    translations: Array
    """(C, 3) camera_from_world."""
    points: Array
    """(M, 3) xyz_in_world."""
    cameras: NDArray[np.int64]
    """(K,) pose of each observation; the observations are sorted by point, those of a point by pose."""
    owners: NDArray[np.int64]
    """(K,) point of each observation."""
    seen: Array
    """(K, 3) x, y in the (left) camera, x in the right one; NaN where there is none."""
    baseline: float = 0.0
    """Baseline of the pair; 0 for one camera."""
    extra: Array = field(default_factory=lambda: np.zeros(LENS))
    """(E,) corrections. For one camera those of focal length f and radial distortion k: seen = x (1 + f + k |x|^2).
    For a pair those of both cameras, and of the right one (see right_camera.TERMS): the left camera sees
    x (1 + k |x|^2 + k2 |x|^4) by the first two, and `factors` @ `extra` is added to the right x."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """(E,) prior standard deviations; 0 fixes a correction."""
    factors: Array = field(default_factory=lambda: np.zeros((0, LENS)))
    """(K, S) Jacobian of a pair's right x by its first S corrections (see right_camera.by_column). The others do not
    change the right x, and only the prior contains them. Empty for one camera."""
    prior: Prior | None = None
    fixed: int = 0
    """Number of first poses that are fixed."""
    families: tuple[PoseFamily, ...] = ()
    """Further residual families of the poses and corrections."""

    def __post_init__(self) -> None:
        # Stacked transposes have another memory layout, for which all kernels would be compiled again.
        object.__setattr__(self, "rotations", np.ascontiguousarray(self.rotations))

    @cached_property
    def observed(self) -> Observed:
        """Returns the arrays for the compiled kernels, with a pair's observations corrected."""
        seen = self.seen
        if self.baseline:
            seen = without_lens(seen, self.extra)
            seen[:, 2] -= self.factors @ self.extra[: self.shown]
        return Observed(
            self.rotations, self.translations, self.points, self.cameras, self.owners, seen,
            self.factors, self.baseline, self.extra,
        )  # fmt: skip

    @property
    def shown(self) -> int:
        """Returns S, the number of first corrections that observations depend on."""
        return self.factors.shape[1] if self.baseline else len(self.extra)

    @cached_property
    def squared_errors(self) -> Array:
        """Returns the squared reprojection errors (K,) over both images; inf behind the camera."""
        return squared_errors(self.observed)

    @cached_property
    def shift(self) -> Array:
        """Returns the change (6 P + E,) since the linearisation of the prior. Raises ValueError without a prior."""
        return required(self.prior, "the window has no prior").shifted(self.rotations, self.translations, self.extra)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Returns all parts of the cost besides the image points."""
        first = CalibrationPrior() if self.prior is None else MarginalPrior(self.prior)
        return first, *self.families
