"""What can be asked of a run of one method, whether it was computed here or read from a folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, counted
from ispom.evaluation.comparison import Comparison, compare, measures
from ispom.evaluation.trajectory_error import alignment_of, associate
from ispom.geometry import Array
from ispom.io.poses.recognised import read_trajectory
from ispom.methods import method
from ispom.notebook.run_folders import run_folders
from ispom.types import Rig, Trajectory

MAX_MB = 5.0
"""Of a view in a cell: a notebook with some of them still opens at once, and about 80 frames have room."""
ALIGNED = {"se3": "SE(3)", "sim3": "Sim(3)"}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Result:
    """A run of one method over one source."""

    source: str
    """The name of the sequence."""
    rig: Rig
    """The sensors of the sequence."""
    truth: Trajectory | None
    """The ground truth, as world_from_FRAME of its own frame."""
    span_ns: tuple[int, int]
    """The first and the last time of the sequence."""
    method: str
    settings: Mapping[str, Any]
    steps: tuple[Any, ...]
    """(S) one for each frame that the method uses, in the order of time."""
    trajectory: Trajectory
    """(N) poses, as revised by the end."""

    @property
    def located(self) -> NDArray[np.bool_]:
        """(S,) which steps gave a pose."""
        return np.array([step.world_from_frame is not None for step in self.steps], bool)

    @property
    def unit(self) -> str:
        """Of lengths: "m", or "own unit" where the method has no scale."""
        return "m" if method(self.method).unit == "metric" else "own unit"

    def evaluate(self, truth: Trajectory | str | Path | None = None) -> Evaluation:
        """Compares the trajectory with a true one (or a pose file of any kind), or that of the sequence, as
        `ispom evaluate` does, over the time of the run.

        Aligned by SE(3) where the method's unit is the metre, else by Sim(3). Raises InputError without a truth, or
        with fewer than three common times.
        """
        if isinstance(truth, (str, Path)):
            truth = read_trajectory(Path(truth), self.trajectory.times_ns).trajectory
        truth = self.truth if truth is None else truth
        if truth is not None and not isinstance(truth, Trajectory):
            raise InputError(f"the truth is a {type(truth).__name__}: give a Trajectory, or the path of a pose file")
        if truth is None:
            raise InputError(f"{self.source} has no ground truth: give one, as in run.evaluate(truth)")
        own, (first, last) = self.trajectory, self.span_ns
        truth = truth.select((truth.times_ns >= first) & (truth.times_ns <= last))
        turn = self.rig.rig_from(truth.frame).inverse() @ self.rig.rig_from(own.frame)
        reference = truth.moved(right=turn, frame=own.frame)
        pairs = associate(own, reference)
        if len(pairs[0]) < 3:
            raise InputError(
                f"{counted(len(pairs[0]), 'pose')} of {self.method} at the times of the ground truth: 3 are needed"
            )
        found = compare(own, reference, pairs, alignment_of(method(self.method).unit == "metric"))
        return Evaluation(found, measures(found))

    def beside_truth(self) -> tuple[Array, Array | None, str]:
        """Returns the positions (N, 3) of the trajectory, the true ones (M, 3) that it was compared with, and the unit
        of both.

        Both have the axes of the method's own world, where z is forward at the first frame: those of a ground truth may
        be any. Without one, or with too few common times, the trajectory is alone, in its own unit.
        """
        own = self.trajectory.translations
        try:
            found = self.evaluate().comparison
        except InputError:
            return own, None, self.unit
        truth_from_own = found.world_from_own
        scale = truth_from_own.scale
        return scale * own, scale * truth_from_own.inverse().apply(found.reference.translations), "m"

    def show(self, frame: int | None = None, *, max_mb: float = MAX_MB) -> Any:
        """Returns a view of the run for a cell: image and tracks of each frame, the path from above, verdict and
        checks. It begins at `frame`, or else at the last step.

        `view.frame` and `view.tracks` are what is chosen in it, and may be set. All of it is in the cell, which takes
        at most `max_mb` MB: of a longer run, one of several frames. Raises InputError where the method has no step at
        the frame.
        """
        return run_folders().show(self, frame, max_mb)

    def plot(self) -> Any:
        """Draws the path from above, with the true one where there is one, and returns matplotlib's figure. Raises
        InputError without the extra `plots`."""
        try:
            from matplotlib.figure import Figure
        except ImportError:
            raise InputError("run.plot needs matplotlib: pip install 'ispom[plots]'") from None
        figure = Figure(figsize=(5, 4), layout="constrained")
        axes = figure.add_subplot()
        path, truth, unit = self.beside_truth()
        if truth is not None:
            axes.plot(*truth[:, [0, 2]].T, color="grey", linewidth=4, label="ground truth")
        axes.plot(*path[:, [0, 2]].T, ".-", label=self.method)
        axes.set(xlabel=f"x [{unit}]", ylabel=f"z [{unit}]", title=self.source, aspect="equal")
        axes.legend()
        return figure

    def __repr__(self) -> str:
        located = f"{int(self.located.sum())} of {counted(len(self.steps), 'frame')} located"
        return f"{type(self).__name__}({self.method} of {self.source}: {located})"

    def _repr_html_(self) -> str:
        rows = {
            "source": self.source,
            "method": self.method,
            "settings": ", ".join(f"{name}={value!r}" for name, value in self.settings.items()) or "default",
            "located": f"{int(self.located.sum())} of {counted(len(self.steps), 'frame')}",
            "path": f"{self.trajectory.length:.4g} {self.unit}",
        }
        if self.truth is not None:
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
        covered = f"{self.comparison.coverage.compared} poses ({100 * self.coverage:.0f} %)"
        return f"ATE {self.ate:.4g} m over {covered}, aligned by {ALIGNED[self.comparison.error.alignment]}"

    def __repr__(self) -> str:
        return f"Evaluation({self})"

    def _repr_html_(self) -> str:
        return _table({name: "–" if value is None else f"{value:.5g}" for name, value in self.measures.items()})


def _table(rows: dict[str, str]) -> str:
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(n)}</th><td>{escape(v)}</td></tr>" for n, v in rows.items()
    )
    return f"<table>{cells}</table>"
