"""How well images determine scale and calibration together, from the normal equations of a scene.

All poses, points and numbers are free at once. Numbers of different units are compared by their effect: the pixels by
which they move the points while all else is fixed. The weakest combination is the one that can move the points the
farthest before the images contradict it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.geometry import Array
from ispom.solvers.least_squares import normal_equations
from ispom.types import Rig

from ..doctor.adjustment import LOSS_PX, Fit, problem_of
from ..doctor.groups import has
from ..doctor.hypothesis import STEPS, Change
from ..doctor.scene import Observations, Scene, predicted

SCALE = "scale_percent"
"""Scale of all distances. It is listed if a pair's baseline determines it. The baseline itself is taken as stated,
since images never determine both."""
BASELINE = "baseline_percent"
STEP_PERCENT = 0.1
DAMPING = 1e-12
"""Damping of the normal equations, relative to their diagonal before the points are eliminated: the unit of one camera
is free."""
WIDEST_PX = 1000.0
"""Largest effect of a number on the points, whatever the images show: none is known worse than its camera."""
LEAST_EFFECT_PX = 1e-9
"""Least effect of one unit of a number; with less the number is not observable."""
LEAST_SHARE = 0.25
"""Share of the largest part of a combination below which parts are not named."""
DECIDED_PX = 1.0
"""A combination that moves the points by less, within one standard deviation, is decided: calibrations with a target
are no better."""


@dataclass(frozen=True)
class Part:
    """A number's part in a combination."""

    name: str
    value: float
    """How much it changes, in its own unit, when the combination changes by one standard deviation; signed."""
    px: float
    """Pixels by which this number alone would move the points."""


@dataclass(frozen=True, eq=False)
class Decided:
    """How well a stretch of images determines N numbers that are free together."""

    names: tuple[str, ...]
    effects_px: Array
    """(N,) by how many pixels one unit of each moves the points (root mean square, in the camera where it is most)."""
    covariance: Array
    """(N, N) in the numbers' own units."""
    noise_px: float
    """Standard deviation of a coordinate of an observation that explains the residuals, with those of a track alike."""

    def sigma(self, name: str) -> float:
        """Returns the standard deviation of a number in its own unit, with all others free."""
        at = self.names.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    @property
    def weakest_px(self) -> float:
        """By how many pixels the weakest combination would move the points, at one standard deviation."""
        return float(np.sqrt(np.linalg.norm(self._by_effect, 2)))

    @property
    def weakest(self) -> tuple[Part, ...]:
        """The weakest combination, its largest part first."""
        values, vectors = np.linalg.eigh(self._by_effect)
        px = vectors[:, -1] * np.sqrt(max(values[-1], 0.0))
        px *= np.sign(px[np.abs(px).argmax()])
        named = [i for i in np.argsort(-np.abs(px), kind="stable") if abs(px[i]) >= LEAST_SHARE * np.abs(px).max()]
        return tuple(Part(self.names[i], float(px[i] / self.effects_px[i]), float(px[i])) for i in named)

    @property
    def _by_effect(self) -> Array:
        return self.covariance * self.effects_px[:, None] * self.effects_px


def decided(scene: Scene, rig: Rig, seen: Observations) -> Decided:
    """Returns how well the observations decide the numbers of the calibration, and the scale where there is a pair.

    The scene must fit the observations. Errors of one track may be alike: the noise is that with which the tracks'
    gradients are as large as they are.
    """
    names = tuple(name for name in STEPS if name != BASELINE and has(rig, name))
    problem, fit = problem_of(scene, rig, seen, names, LOSS_PX), Fit(scene, np.zeros(len(names)))
    poses = problem.shared - len(names)
    by_number = problem.families[0].derivatives(fit).by_shared[..., 12:]
    by_number = np.concatenate([_by_scale(scene, rig, seen)[..., None], by_number], axis=2)
    effects = np.sqrt([(by_number[seen.camera == c] ** 2).mean(axis=(0, 1)) for c in np.unique(seen.camera)]).max(
        axis=0
    )
    equations = normal_equations(problem, fit)
    reduced = equations.eliminated(DAMPING)
    scores = reduced.scores(equations)
    inflation = float((scores * np.linalg.lstsq(reduced.matrix, scores.T, rcond=1e-15)[0].T).sum()) / problem.shared
    widest = inflation * (np.maximum(effects[1:], LEAST_EFFECT_PX) / WIDEST_PX) ** 2
    wanted = np.eye(problem.shared)[:, poses - 1 :]
    wanted[:, 0] = np.concatenate([_scale_of(scene), np.zeros(len(names))])
    matrix = reduced.matrix + np.diag(np.concatenate([np.zeros(poses), widest]))
    covariance = inflation * (wanted.T @ np.linalg.solve(matrix, wanted))
    shown = np.flatnonzero(effects > LEAST_EFFECT_PX)
    every = (SCALE, *names)
    return Decided(
        tuple(every[i] for i in shown),
        effects[shown],
        covariance[np.ix_(shown, shown)],
        LOSS_PX * float(np.sqrt(inflation)),
    )


def _by_scale(scene: Scene, rig: Rig, seen: Observations) -> Array:
    """Returns by how much one percent more of all distances moves the observations (N, 2)."""
    if not rig.has_stereo:
        return np.zeros((len(seen), 2))
    origin, factor = scene.positions[0], 1 + STEP_PERCENT / 100
    larger = replace(
        scene, positions=origin + factor * (scene.positions - origin), points=origin + factor * (scene.points - origin)
    )
    before, after = (predicted(each, rig, Change(), seen, False).residuals for each in (scene, larger))
    return np.nan_to_num(before - after) / STEP_PERCENT


def _scale_of(scene: Scene) -> Array:
    """Returns the derivatives (G,) of the scale [%] by the twists of all poses but the first."""
    away = scene.positions[1:] - scene.positions[0]
    slopes = np.zeros((len(away), 6))
    slopes[:, 3:] = 100 * away / max(float((away**2).sum()), 1e-12)
    return slopes.ravel()
