"""From calibration error to trajectory error: predicts the trajectory that a run would have had.

A method with a window estimates each pose, and its camera corrections, from the observations until then; later ones do
not change it. So each keyframe's motion is computed from the problem at the time when the keyframe left the window.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ispom.evaluation.sensitivity.linear import Steps, Values, solve, start
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.evaluation.sensitivity.scene import Adjustment, Scene
from ispom.evaluation.trajectory_error import Alignment, aligned, ate_m
from ispom.geometry import Array, Pose
from ispom.types import Trajectory

DIFFERENCE_STEP = 1e-3
"""Step of the difference quotients, in units of the perturbations (percent, px)."""
KEYFRAME_GROWTH = 0.1
"""Relative growth of the number of keyframes after which the problem is solved again, as each one changes it less."""
MIN_EFFECT = 1e-9
"""Least change of an error that depends on a perturbation."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The derivatives of the keyframes of one method's run by each part of a Perturbation."""

    scene: Scene
    adjustment: Adjustment
    values: Values
    errors: Array
    """(N, 2 or 3) errors of the run itself."""
    names: tuple[str, ...]
    """(P,) the fields of a Perturbation that the method depends on."""
    by_error: Array
    """(N, 2 or 3, P) partial derivatives of the errors by each field."""
    poses: Array
    """(K, 6, P) twists of the keyframes in the world, per unit, when they left the window."""
    whole: Steps
    """The solution with all observations."""

    @staticmethod
    def of(scene: Scene, adjustment: Adjustment) -> Sensitivity:
        """Linearises at the result of the run."""
        values = start(scene, adjustment)
        q = scene.in_camera(values.rotations, values.translations, values.xyz_in_world)
        errors = scene.errors(q, values.extra, Perturbation())
        names, columns = [], []
        for field in fields(Perturbation):
            ends = [
                scene.errors(q, values.extra, Perturbation(**{field.name: sign * DIFFERENCE_STEP})) for sign in (1, -1)
            ]
            column = (ends[0] - ends[1]) / (2 * DIFFERENCE_STEP)
            if abs(column).max(initial=0.0) > MIN_EFFECT:
                names.append(field.name)
                columns.append(column)
        by_error = np.stack(columns, axis=2)
        whole = solve(scene, values, adjustment, errors, by_error)
        poses = _fixed_motions(scene, adjustment, errors, by_error, whole)
        return Sensitivity(
            scene=scene,
            adjustment=adjustment,
            values=values,
            errors=errors,
            names=tuple(names),
            by_error=by_error,
            poses=poses,
            whole=whole,
        )

    def amounts(self, perturbation: Perturbation) -> Array:
        """Returns the amounts (P,) of the perturbation, in the order of `names`."""
        return np.array([getattr(perturbation, name) for name in self.names])

    def twists(self, perturbation: Perturbation) -> Array:
        """Returns twists (K, 6) of the keyframes in the world."""
        return self.poses @ self.amounts(perturbation)

    def predicted(self, run: Trajectory, perturbation: Perturbation) -> Trajectory:
        """Returns the run's trajectory (of any frame) as it would have been with the perturbed calibration."""
        return moved(run, self.scene, self.twists(perturbation))

    def nonlinearity(self, perturbation: Perturbation) -> float:
        """Returns the size of the next Gauss-Newton step relative to the first, RMS over the keyframes' positions."""
        amounts = self.amounts(perturbation)
        first, whole = self.whole.poses @ amounts, self.whole
        values = self.values.moved(first, whole.points @ amounts, whole.extra @ amounts)
        scene = self.scene
        q = scene.in_camera(values.rotations, values.translations, values.xyz_in_world)
        errors = scene.errors(q, values.extra, perturbation)
        # The run is at its optimum, so the step depends on the errors by the perturbation only.
        second = solve(scene, values, self.adjustment, errors, (errors - self.errors)[..., None]).poses[..., 0]
        positions = self.values.positions
        one, other = (np.linalg.norm(s[:, :3] + np.cross(s[:, 3:], positions), axis=1) for s in (first, second))
        size = float(np.sqrt((one**2).mean()))
        return float(np.sqrt((other**2).mean())) / size if size > 0 else 0.0


def _fixed_motions(scene: Scene, adjustment: Adjustment, errors: Array, by_error: Array, whole: Steps) -> Array:
    """Returns the derivatives (K, 6, P) of motions between keyframes, at the time when the later one left the
    window."""
    count = len(scene.times_ns)
    ends = _ends(adjustment.window, count)
    poses_by_count = {count: whole.poses}
    for end in ends[:-1]:
        part, keep = scene.until(end)
        poses_by_count[end] = solve(part, start(part, adjustment), adjustment, errors[keep], by_error[keep]).poses
    out = np.zeros_like(whole.poses)
    for k in range(1, count):
        known = poses_by_count[next(end for end in ends if end >= min(k + adjustment.window, count))]
        out[k] = out[k - 1] + known[k] - known[k - 1]
    return out


def _ends(window: int, count: int) -> list[int]:
    """Returns increasing numbers of keyframes: each one at first, then growing by KEYFRAME_GROWTH, up to all."""
    out, end = [], min(max(window, 2), count)
    while end < count:
        out.append(end)
        end += max(1, int(KEYFRAME_GROWTH * end))
    return [*out, count]


def moved(run: Trajectory, scene: Scene, twists: Array) -> Trajectory:
    """Moves a trajectory in the scene's world by twists (K, 6) at its keyframes, linear between those."""
    start_ns = scene.times_ns[0]
    knots_s, times_s = ((times - start_ns) * 1e-9 for times in (scene.times_ns, run.times_ns))
    interpolated = np.stack([np.interp(times_s, knots_s, column) for column in twists.T], axis=1)
    steps = [Pose.exp(twist) for twist in interpolated]
    rotations, translations = np.stack([s.rotation for s in steps]), np.stack([s.translation for s in steps])
    return replace(
        run,
        rotations=rotations @ run.rotations,
        translations=np.einsum("nij,nj->ni", rotations, run.translations) + translations,
    )


def shift_m(run: Trajectory, other: Trajectory, kind: Alignment) -> float:
    """Returns the RMS distance of two trajectories at their common times, the other aligned to the run."""
    common = np.intersect1d(run.times_ns, other.times_ns)
    one, two = (t.select(np.searchsorted(t.times_ns, common)) for t in (run, other))
    return ate_m(aligned(two, one, kind), one)
