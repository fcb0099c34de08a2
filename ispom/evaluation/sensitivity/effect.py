"""From calibration error to trajectory error: the trajectory that a run would have had, predicted from what it saw.

A method with a window settles each pose by what it saw until then, and corrects its cameras by it as well; what it
learns later does not bring back what it has settled. So each key frame's motion is taken from the problem that the
method knew when the key frame left its window.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ispom.evaluation.ate import Alignment, aligned, ate_m
from ispom.evaluation.sensitivity.linear import Steps, Values, solve, start
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.evaluation.sensitivity.scene import Adjustment, Scene
from ispom.geometry import Array, Pose
from ispom.types import Trajectory

STEP = 1e-3
"""Of the difference quotients, in units of the perturbations (percent, px)."""
SPARSER = 0.1
"""Share of the key frames so far after which what they know is asked anew: it changes less and less."""
NEGLIGIBLE = 1e-9
"""Errors that change by less than this do not depend on a perturbation."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Of one method's run: how its key frames move with each part of a Perturbation."""

    scene: Scene
    adjustment: Adjustment
    values: Values
    errors: Array
    """(N, 2 or 3) of the run itself."""
    names: tuple[str, ...]
    """(P,) the fields of a Perturbation that the method depends on."""
    by_error: Array
    """(N, 2 or 3, P) how errors change with each, all else held."""
    poses: Array
    """(K, 6, P) twists of the key frames in the world, per unit, as they were settled."""
    whole: Steps
    """By all that was seen in the end."""

    @staticmethod
    def of(scene: Scene, adjustment: Adjustment) -> Sensitivity:
        """Linearised where the run came to."""
        values = start(scene, adjustment)
        q = scene.in_camera(values.rotations, values.translations, values.xyz_in_world)
        errors = scene.errors(q, values.extra, Perturbation())
        names, columns = [], []
        for field in fields(Perturbation):
            ends = [scene.errors(q, values.extra, Perturbation(**{field.name: sign * STEP})) for sign in (1, -1)]
            column = (ends[0] - ends[1]) / (2 * STEP)
            if abs(column).max(initial=0.0) > NEGLIGIBLE:
                names.append(field.name)
                columns.append(column)
        by_error = np.stack(columns, axis=2)
        whole = solve(scene, values, adjustment, errors, by_error)
        poses = _settled(scene, adjustment, errors, by_error, whole)
        return Sensitivity(scene, adjustment, values, errors, tuple(names), by_error, poses, whole)

    def amounts(self, wrong: Perturbation) -> Array:
        """(P,) of the perturbation, by name."""
        return np.array([getattr(wrong, name) for name in self.names])

    def twists(self, wrong: Perturbation) -> Array:
        """(K, 6) of the key frames in the world."""
        return self.poses @ self.amounts(wrong)

    def predicted(self, run: Trajectory, wrong: Perturbation) -> Trajectory:
        """The run's trajectory (of any frame) as it would have been with the wrong calibration."""
        return moved(run, self.scene, self.twists(wrong))

    def nonlinearity(self, wrong: Perturbation) -> float:
        """The next Gauss-Newton step over the first, root mean square over the places of the key frames."""
        amounts = self.amounts(wrong)
        first, whole = self.whole.poses @ amounts, self.whole
        values = self.values.moved(first, whole.points @ amounts, whole.extra @ amounts)
        scene = self.scene
        q = scene.in_camera(values.rotations, values.translations, values.xyz_in_world)
        errors = scene.errors(q, values.extra, wrong)
        # What the run left of its own errors is no reason to move; only what the perturbation adds is.
        second = solve(scene, values, self.adjustment, errors, (errors - self.errors)[..., None]).poses[..., 0]
        places = self.values.places
        one, other = (np.linalg.norm(s[:, :3] + np.cross(s[:, 3:], places), axis=1) for s in (first, second))
        size = float(np.sqrt((one**2).mean()))
        return float(np.sqrt((other**2).mean())) / size if size > 0 else 0.0


def _settled(scene: Scene, adjustment: Adjustment, errors: Array, by_error: Array, whole: Steps) -> Array:
    """(K, 6, P): the motion from each key frame to the next as of when the later one left the window."""
    count = len(scene.times_ns)
    ends = _ends(adjustment.window, count)
    found = {count: whole.poses}
    for end in ends[:-1]:
        part, keep = scene.until(end)
        found[end] = solve(part, start(part, adjustment), adjustment, errors[keep], by_error[keep]).poses
    out = np.zeros_like(whole.poses)
    for k in range(1, count):
        known = found[next(end for end in ends if end >= min(k + adjustment.window, count))]
        out[k] = out[k - 1] + known[k] - known[k - 1]
    return out


def _ends(window: int, count: int) -> list[int]:
    """How many key frames were known, increasing up to all: each at first, then in steps of a share of those before."""
    out, end = [], min(max(window, 2), count)
    while end < count:
        out.append(end)
        end += max(1, int(SPARSER * end))
    return [*out, count]


def moved(run: Trajectory, scene: Scene, twists: Array) -> Trajectory:
    """A trajectory in the scene's world after twists (K, 6) of the world at its key frames, linear between those."""
    start_ns = scene.times_ns[0]
    knots, asked = ((times - start_ns) * 1e-9 for times in (scene.times_ns, run.times_ns))
    along = np.stack([np.interp(asked, knots, column) for column in twists.T], axis=1)
    steps = [Pose.exp(twist) for twist in along]
    turns, shifts = np.stack([s.rotation for s in steps]), np.stack([s.translation for s in steps])
    return replace(
        run, rotations=turns @ run.rotations, translations=np.einsum("nij,nj->ni", turns, run.translations) + shifts
    )


def shift_m(run: Trajectory, other: Trajectory, kind: Alignment) -> float:
    """Root mean square distance of two trajectories at their common times, the other aligned to the run."""
    common = np.intersect1d(run.times_ns, other.times_ns)
    one, two = (t.select(np.searchsorted(t.times_ns, common)) for t in (run, other))
    return ate_m(aligned(two, one, kind), one)
