"""The curves of a recording, below /plots: errors, scale, inliers, residuals, and milliseconds per stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from ispom.geometry import Similarity
from ispom.methods import method as registered
from ispom.types import Step

from .. import colours
from ..run.events import Opened, Stepped
from ..run.model.run_model import RunModel
from .batch import Entry

NO_ERROR = "plots/error/none"
"""Where it stands why there is no position error."""
LEAST_STEP_M = 0.05
"""Shorter true steps have no ratio: it would be noise."""


class Plots:
    """Follows one run."""

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self._drifts: set[str] = set()
        """Methods that tell how far their unit may have drifted."""
        self._stages: dict[str, list[str]] = {m: [] for m in opened.methods}

    def opening(self) -> Iterator[Entry]:
        """Names and colours (all static)."""
        if reason := why_no_error(self._opened):
            yield Entry(NO_ERROR, rr.TextDocument(reason), static=True)
        for method in self._opened.methods:
            colour = colours.of(method)
            for kind in ("error", "inliers", "residual"):
                yield Entry(f"plots/{kind}/{method}", _series(_name(method), colour), static=True)
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
            if len(step.residuals_px):
                yield Entry(f"plots/inliers/{step.method}", rr.Scalars(len(step.residuals_px)))
                yield Entry(f"plots/residual/{step.method}", rr.Scalars(float(np.median(step.residuals_px))))
            yield from self._times(step.method, step.seconds)

    def _errors(self, step: Step, event: Stepped, model: RunModel, placement: Similarity) -> Iterator[Entry]:
        method = step.method
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
        """Distance covered in the last second over the true one."""
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
    """Why a run has no position error to plot; empty where it has."""
    if opened.truth is None:
        return "No position error: this source has no ground truth."
    if all(registered(method).unit == "own" for method in opened.methods):
        return (
            "No position error: a single camera's trajectory has no metric unit, so the true path is not drawn either. "
            "To compare them, use ispom run, then ispom evaluate with --alignment sim3, which estimates the scale."
        )
    return ""


def _name(method: str) -> str:
    """As people read it."""
    return method.replace("_", " ")


def _series(name: str, colour: colours.Rgb, width: float = 1.5) -> rr.SeriesLines:
    return rr.SeriesLines(names=name, colors=colour, widths=width)


def _stage_series(method: str, stages: list[str]) -> rr.SeriesLines:
    """The total in the method's colour, its stages in colours of their own."""
    return rr.SeriesLines(
        names=[_name(method), *(f"{_name(method)}: {stage}" for stage in stages)],
        colors=[colours.of(method), *(colours.stage(i) for i in range(len(stages)))],
        widths=[2.5, *[1.0] * len(stages)],
    )


def _drift_series(method: str) -> rr.SeriesLines:
    """What the unit may have become since the start, one standard deviation up and down."""
    colour = colours.shade(colours.of(method), (128, 128, 128), 0.7)
    names = [f"{_name(method)}: scale drift, {side} sigma" for side in ("+1", "-1")]
    return rr.SeriesLines(names=names, colors=[colour, colour], widths=[1.0, 1.0])
