"""A whole run in one call, and what can be asked of it: `ispom.run("kitti/sequences/06", "stereo")`."""

from __future__ import annotations

from collections.abc import Sequence as Listed
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.ensemble import Ensemble, build
from ispom.errors import InputError, counted
from ispom.evaluation.comparison import Comparison, compare, measures
from ispom.evaluation.trajectory_error import alignment_of, associate
from ispom.geometry import Array
from ispom.methods import Config, method
from ispom.sequences import open_sequence
from ispom.settings import checked
from ispom.settings import settings as settings_of
from ispom.types import Frame, Rig, Sequence, Step, Trajectory

RATE_HZ = 30.0
"""Of images without times."""
Source = Sequence | str | Path | Listed[Any]
"""A sequence, a path or name as `ispom run` takes it, or images: arrays of a video, or pairs of arrays."""


def run(
    source: Source,
    name: str,
    *,
    rig: Rig | None = None,
    rate_hz: float = RATE_HZ,
    frames: int | None = None,
    **settings: Any,
) -> Run:
    """Runs a method, with those that it depends on, over a source.

    `rig` and `rate_hz` are for images only; `frames` ends the run after so many. `settings` are those of the method,
    as in max_tracks=300. Raises InputError where the source or the method cannot be used, or a setting is none.
    """
    sequence = opened(source, rig, rate_hz)
    sequence = sequence if frames is None else sequence[:frames]
    ensemble, steps = built(sequence, name, settings), list[Step]()
    state = ensemble.start()
    for i in range(len(sequence)):
        state, found = ensemble.step(state, sequence[i])
        steps += found
    return Run(sequence, name, settings, tuple(steps), ensemble.finish(state)[name])


def opened(source: Source, rig: Rig | None = None, rate_hz: float = RATE_HZ) -> Sequence:
    """Returns the source as a sequence. Raises InputError as `run`."""
    if isinstance(source, Sequence):
        return source
    if isinstance(source, (str, Path)):
        return open_sequence(str(source))
    if rig is None:
        raise InputError("images need their cameras: give rig=ispom.Rig.of(video=ispom.Camera(...))")
    if not rate_hz > 0:
        raise InputError(f"rate_hz is {rate_hz:g}: give a positive number of images per second")
    times_ns = np.rint(np.arange(len(source)) * 1e9 / rate_hz).astype(np.int64)
    loaded = [_frame(int(t), images) for t, images in zip(times_ns, source, strict=True)]
    return Sequence("images", rig, times_ns, tuple(frame.kind for frame in loaded), loaded.__getitem__)


def _frame(time_ns: int, images: Any) -> Frame:
    if isinstance(images, (tuple, list)):
        if len(images) != 2:
            raise InputError(f"{counted(len(images), 'image')} at {time_ns} ns: give one array, or a pair of them")
        return Frame.stereo(time_ns, *images)
    return Frame.video(time_ns, images)


def built(sequence: Sequence, name: str, settings: dict[str, Any]) -> Ensemble:
    """Returns the method with these settings for the sequence. Raises InputError as `run`."""
    if not isinstance(name, str):
        raise InputError(f"the method is {str(name)[:40]!r}: give its name, as in ispom.run(source, 'stereo')")
    config = method(name).config
    known = [setting.name for setting in settings_of(config)]
    if unknown := [each for each in settings if each not in known]:
        raise InputError(f"{name} has no setting {unknown[0]!r}: choose from {', '.join(known)}")
    return build(Config({name: checked(config(**settings))}), (name,), sequence.rig)


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A finished run of one method."""

    sequence: Sequence
    method: str
    settings: dict[str, Any]
    """Those that were given."""
    steps: tuple[Step, ...]
    """One for each frame that the method uses, in the order of time."""
    trajectory: Trajectory
    """(N) poses, as revised by the end."""

    @property
    def covariances(self) -> Array:
        """(S, 6, 6) of each step's pose as it was given then, of the twist (rho, phi) on its right; NaN where the step
        has none."""
        none = np.full((6, 6), np.nan)
        return np.array([none if step.covariance is None else step.covariance for step in self.steps]).reshape(-1, 6, 6)

    @property
    def located(self) -> NDArray[np.bool_]:
        """(S,) which steps gave a pose."""
        return np.array([step.world_from_frame is not None for step in self.steps], bool)

    def step_at(self, frame: int) -> Step:
        """Returns the step at a frame of the sequence. Raises InputError where the method did not use that frame."""
        time_ns, kind = int(self.sequence.times_ns[frame]), self.sequence.kinds[frame]
        found = next((step for step in self.steps if step.time_ns == time_ns), None)
        if found is None or not method(self.method).uses(self.sequence[frame]):
            raise InputError(f"{self.method} did not step at frame {frame}, which is a {kind} frame")
        return found

    def evaluate(self, truth: Trajectory | None = None) -> Evaluation:
        """Compares the trajectory with a true one of the rig, or that of the sequence, as `ispom evaluate` does,
        over the time of the sequence.

        Aligned by SE(3) where the method's unit is the metre, else by Sim(3). Raises InputError without a truth, or
        with fewer than three common times.
        """
        truth = self.sequence.truth if truth is None else truth
        if truth is None:
            raise InputError(f"{self.sequence.name} has no ground truth: give one, as in run.evaluate(truth)")
        first, last = self.sequence.times_ns[[0, -1]]
        truth = truth.select((truth.times_ns >= first) & (truth.times_ns <= last))
        own, frame = self.trajectory, self.trajectory.frame
        reference = truth.moved(right=self.sequence.rig.rig_from(frame), frame=frame)
        pairs = associate(own, reference)
        if len(pairs[0]) < 3:
            raise InputError(
                f"{counted(len(pairs[0]), 'pose')} of {self.method} at the times of the ground truth: 3 are needed"
            )
        found = compare(own, reference, pairs, alignment_of(method(self.method).unit == "metric"))
        return Evaluation(found, measures(found))

    def plot(self) -> Any:
        """Draws the path from above, with the true one where there is one, and returns matplotlib's figure. Raises
        InputError without the extra `plots`."""
        try:
            from matplotlib.figure import Figure
        except ImportError:
            raise InputError("run.plot needs matplotlib: pip install 'ispom[plots]'") from None
        figure = Figure(figsize=(5, 4), layout="constrained")
        axes, path, unit = figure.add_subplot(), self.trajectory, method(self.method).unit
        if self.sequence.truth is not None:
            try:
                found = self.evaluate().comparison
                path, unit = found.estimate, "metric"
                axes.plot(*found.reference.translations[:, [0, 2]].T, color="grey", linewidth=4, label="ground truth")
            except InputError:
                pass  # too few common times: the path alone
        axes.plot(*path.translations[:, [0, 2]].T, ".-", label=self.method)
        length = "m" if unit == "metric" else "own unit"
        axes.set(xlabel=f"x [{length}]", ylabel=f"z [{length}]", title=self.sequence.name, aspect="equal")
        axes.legend()
        return figure

    def __repr__(self) -> str:
        return (
            f"Run({self.method} of {self.sequence.name}: {int(self.located.sum())} of {len(self.steps)} frames located)"
        )

    def _repr_html_(self) -> str:
        rows = {
            "source": self.sequence.name,
            "method": self.method,
            "settings": ", ".join(f"{name}={value!r}" for name, value in self.settings.items()) or "default",
            "located": f"{int(self.located.sum())} of {counted(len(self.steps), 'frame')}",
            "path": f"{self.trajectory.length:.4g} {'m' if method(self.method).unit == 'metric' else 'own units'}",
        }
        if self.sequence.truth is not None:
            try:
                rows["error"] = str(self.evaluate())
            except InputError as reason:
                rows["error"] = str(reason)
        return _table(rows)


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """How far a trajectory is from the true one."""

    comparison: Comparison
    measures: dict[str, float | None]
    """By name with unit, as `ispom evaluate --json` has them; None where the path is too short for one."""

    @property
    def ate(self) -> float:
        """Root mean square of the aligned positions' distances from the true ones [m]."""
        return float(self.comparison.error.ate_m)

    @property
    def coverage(self) -> float:
        """Share of the expected poses that were given, 0..1."""
        return self.comparison.coverage.compared / max(self.comparison.coverage.expected, 1)

    def __str__(self) -> str:
        how = self.comparison.error.alignment
        return (
            f"ATE {self.ate:.4g} m over {self.comparison.coverage.compared} poses ({100 * self.coverage:.0f} %), {how}"
        )

    def __repr__(self) -> str:
        return f"Evaluation({self})"

    def _repr_html_(self) -> str:
        return _table({name: "–" if value is None else f"{value:.5g}" for name, value in self.measures.items()})


def _table(rows: dict[str, str]) -> str:
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(n)}</th><td>{escape(v)}</td></tr>" for n, v in rows.items()
    )
    return f"<table>{cells}</table>"
