"""The curves of a recording, below /plots: errors, scale, inliers, residuals, and milliseconds per stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from ispom.evaluation.trajectory_error import alignment_of, error_against_truth
from ispom.geometry import Similarity
from ispom.methods import method as registered
from ispom.solvers.trajectory.alignment import RunningAlignment
from ispom.types import Step

from ...engine.events import Finished, Opened, Stepped
from ...engine.frame_record import INLIERS, RESIDUAL
from ...engine.history.quantities import step_number
from ...engine.model.run_model import RunModel
from ...engine.model.true_path import FIRST
from ...presentation import colours
from ...presentation.texts import ALIGNED
from .batch import Columns, Entry

NO_ERROR = "plots/error/none"
"""Entity of the text that says why there is no position error."""
LEAST_STEP_M = 0.05
"""Least true step for which a scale ratio is computed: that of a shorter one would be noise."""


class Plots:
    """Draws the curves of one run."""

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self._drifts: set[str] = set()
        """Methods that estimate their scale drift."""
        single = opened.truth is not None and all(registered(m).unit == "own" for m in opened.methods)
        self._aligning = {m: RunningAlignment() for m in opened.methods if single}
        """By method whose unit nothing fixes: its running alignment, if there is a truth."""
        self._stages: dict[str, list[str]] = {m: [] for m in opened.methods}

    def opening(self) -> Iterator[Entry]:
        """Names and colours (all static)."""
        if reason := why_no_error(self._opened):
            yield Entry(NO_ERROR, rr.TextDocument(reason), static=True)
        for method in self._opened.methods:
            colour = colours.of(method)
            for kind in ("error", "inliers", "residual"):
                name = f"{_name(method)}: live" if kind == "error" else _name(method)
                yield Entry(f"plots/{kind}/{method}", _series(name, colour), static=True)
            if method in self._aligning:
                name = f"{_name(method)}: newest pose, Sim(3) over the poses so far"
                yield Entry(f"plots/error/{method}/sim3", _series(name, colour), static=True)
            for kind, name, pale in (
                ("transferred", registered(method).scale, 0.5),
                ("of_truth", "step / true step", 0.0),
            ):
                series = _series(f"{_name(method)}: {name}", colours.shade(colour, (128, 128, 128), pale))
                yield Entry(f"plots/scale/{method}/{kind}", series, static=True)

    def stepped(self, event: Stepped, model: RunModel, placements: Mapping[str, Similarity]) -> Iterator[Entry]:
        """`model` is that after the event."""
        for step in event.steps:
            yield from self._errors(step, event, model, placements.get(step.method, Similarity()))
            yield from self._scale(step)
            for kind, key in (("inliers", INLIERS.key), ("residual", RESIDUAL.key)):
                if (value := step_number(step, key)) is not None:
                    yield Entry(f"plots/{kind}/{step.method}", rr.Scalars(value))
            yield from self._times(step.method, step.seconds)

    def finished(self, event: Finished, model: RunModel, first_ns: int) -> Iterator[Entry | Columns]:
        """The aligned error curves of the final trajectories, whose root mean square is the ATE."""
        truth, rig = self._opened.truth, self._opened.sequence.rig
        for method, trajectory in event.trajectories.items():
            kind = alignment_of(registered(method).unit == "metric")
            error = error_against_truth(trajectory, truth, rig, kind) if truth is not None else None
            if error is None:
                continue
            path, name = f"plots/error/{method}/aligned", f"{_name(method)}: {ALIGNED[kind]}, at the end"
            colour = colours.shade(colours.of(method), (128, 128, 128), 0.5)
            yield Entry(path, _series(name, colour, 2.5), static=True)
            indices = model.times.indices(model.times.rows(error.estimate.times_ns))
            yield Columns(path, error.estimate, indices, first_ns, error.position_errors_m)

    def _newest(self, step: Step) -> Iterator[Entry]:
        """For a single camera: yields the distance of its newest pose from the truth, after an alignment by Sim(3) of
        all its poses so far, as they were given. Each frame costs the same, because the alignment uses sums."""
        running, truth = self._aligning.get(step.method), self._opened.truth
        pose = truth.at(step.time_ns) if truth is not None else None
        if running is None or pose is None or step.world_from_frame is None:
            return
        true = (pose @ self._opened.sequence.rig.rig_from(step.frame)).translation
        if step.restarted:
            running = self._aligning[step.method] = RunningAlignment()  # the new segment has another world and unit
        running.add(step.world_from_frame.translation, true)
        if running.count >= FIRST:
            away = running.target_from_source.apply(step.world_from_frame.translation) - true
            yield Entry(f"plots/error/{step.method}/sim3", rr.Scalars(float(np.linalg.norm(away))))

    def _errors(self, step: Step, event: Stepped, model: RunModel, placement: Similarity) -> Iterator[Entry]:
        method = step.method
        yield from self._newest(step)
        if method in event.errors_m:
            yield Entry(f"plots/error/{method}", rr.Scalars(event.errors_m[method]))
            ratio = self._step_of_truth(step, model, placement)
            if ratio is not None:
                yield Entry(f"plots/scale/{method}/of_truth", rr.Scalars(ratio))

    def _scale(self, step: Step) -> Iterator[Entry]:
        method = step.method
        if step.scale is not None:
            yield Entry(f"plots/scale/{method}/transferred", rr.Scalars(step.scale))
        if step.scale_sigma is not None:
            if method not in self._drifts:
                self._drifts.add(method)
                yield Entry(f"plots/scale/{method}/drift", _drift_series(method), static=True)
            band = np.exp(step.scale_sigma * np.array([1.0, -1.0]))
            yield Entry(f"plots/scale/{method}/drift", rr.Scalars(band))

    def _times(self, method: str, seconds: Mapping[str, float]) -> Iterator[Entry]:
        stages = self._stages[method]
        new = [stage for stage in seconds if stage not in stages]
        if new:
            stages += new
            yield Entry(f"plots/ms/{method}", _stage_series(method, stages), static=True)
        if seconds:
            values = [sum(seconds.values()), *(seconds.get(stage, np.nan) for stage in stages)]
            yield Entry(f"plots/ms/{method}", rr.Scalars(1e3 * np.array(values)))

    def _step_of_truth(self, step: Step, model: RunModel, placement: Similarity) -> float | None:
        """Returns the distance moved in the last second, divided by the true one."""
        earlier = model.methods[step.method].poses.second_before(model.times, step.time_ns)
        truth, rig = self._opened.truth, self._opened.sequence.rig
        if earlier is None or truth is None or step.world_from_frame is None:
            return None
        before, after = truth.at(earlier[0]), truth.at(step.time_ns)
        if before is None or after is None:
            return None
        lever = rig.rig_from(step.frame).translation
        true = float(np.linalg.norm(after.apply(lever) - before.apply(lever)))
        estimated = placement.scale * float(np.linalg.norm(step.world_from_frame.translation - earlier[1]))
        return estimated / true if true > LEAST_STEP_M else None


def why_no_error(opened: Opened) -> str:
    """Returns why a run has no position error to plot; empty where it has one."""
    if opened.truth is None:
        return "No position error: this source has no ground truth."
    return ""


def _name(method: str) -> str:
    """Returns the method's name for people."""
    return method.replace("_", " ")


def _series(name: str, colour: colours.Rgb, width: float = 1.5) -> rr.SeriesLines:
    return rr.SeriesLines(names=name, colors=colour, widths=width)


def _stage_series(method: str, stages: list[str]) -> rr.SeriesLines:
    """Returns lines of the total in the method's colour, and of its stages in other colours."""
    return rr.SeriesLines(
        names=[_name(method), *(f"{_name(method)}: {stage}" for stage in stages)],
        colors=[colours.of(method), *(colours.stage(i) for i in range(len(stages)))],
        widths=[2.5, *[1.0] * len(stages)],
    )


def _drift_series(method: str) -> rr.SeriesLines:
    """Returns lines of the scale drift since the start, plus and minus one standard deviation."""
    colour = colours.shade(colours.of(method), (128, 128, 128), 0.7)
    names = [f"{_name(method)}: scale drift, {side} sigma" for side in ("+1", "-1")]
    return rr.SeriesLines(names=names, colors=[colour, colour], widths=[1.0, 1.0])
