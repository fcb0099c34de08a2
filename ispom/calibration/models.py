"""Choice of the camera model: each is fitted to half of the views and tested on the rest; the simplest good one
wins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ispom.calibration.adjust.lens import MODELS, Model, as_model
from ispom.calibration.adjust.problem import Estimate, Observations, Unknowns
from ispom.calibration.adjust.solve import Solution, adjust_views, solve, start_of, with_views
from ispom.geometry import Array
from ispom.types import Camera

Choice = Literal["auto", "pinhole", "radtan", "rational", "fisheye"]
BETTER, BETTER_PX = 0.02, 0.1
"""A model with more parameters must be better by this share and this error: beyond the views it is more uncertain,"""
SIGNIFICANT = 2.0
"""and by this many standard errors of the difference over the views."""
MOST_VIEWS = 20
"""Models are compared on at most this many views, spread over all."""
LEAST_VIEWS = 4
"""Views in each half; with fewer views no model is chosen, but radtan used."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One model."""

    model: Model
    held_out_px: float
    """Root mean square error on views that it was not fitted to."""
    of_views_px: Array
    """(V,) the same of each view."""
    halves: tuple[Camera, Camera]
    """The cameras solved from each half of the views."""
    solution: Solution
    """The solution from all views of the comparison."""

    @property
    def camera(self) -> Camera:
        """The camera of the solution."""
        return self.solution.estimate.cameras[0]


def trials_of(seen: Observations, size: tuple[int, int], choice: Choice) -> tuple[Trial, ...]:
    """Tries every model that is plausible for a camera with images (width, height), or only the requested one."""
    models = MODELS if choice == "auto" else (choice,)
    views = np.unique(seen.view)
    if choice == "auto" and len(views) < 2 * LEAST_VIEWS:
        models = ("radtan",)
    if len(views) > MOST_VIEWS:
        seen = seen.of_views(views[np.linspace(0, len(views) - 1, MOST_VIEWS).astype(int)])
    out: list[Trial] = []
    simpler: Estimate | None = None
    for model in models:
        if model == "fisheye" or simpler is None:
            start = start_of(seen, size, model)
        else:
            start = replace(simpler, cameras=(as_model(simpler.cameras[0], model),))
        trial = _trial(model, start, seen)
        simpler = simpler if model == "fisheye" else trial.solution.estimate
        out.append(trial)
    return tuple(out)


def chosen(trials: tuple[Trial, ...]) -> Trial:
    """Returns the simplest that no other one beats clearly."""
    best = trials[0]
    for trial in trials[1:]:
        gain = best.of_views_px - trial.of_views_px
        error = float(np.std(gain) / np.sqrt(len(gain)))
        enough = max(BETTER * best.held_out_px, BETTER_PX)
        if trial.held_out_px < best.held_out_px - enough and gain.mean() > SIGNIFICANT * error:
            best = trial
    return best


def _trial(model: Model, start: Estimate, seen: Observations) -> Trial:
    found, _ = solve(start, seen, Unknowns.all_of(start))
    views = np.unique(found.seen.view)
    halves = views[::2], views[1::2]
    cameras: list[Camera] = []
    errors = np.full(int(seen.view.max()) + 1, np.nan)
    for own, other in (halves, halves[::-1]):
        camera = _solved(found.estimate, found.seen.of_views(own)) if len(own) else found.estimate.cameras[0]
        cameras.append(camera)
        if len(other):
            errors[other] = _tried(camera, seen.of_views(other))
    good = errors[np.isfinite(errors)]
    held_out = float(np.sqrt((good**2).mean())) if len(good) else np.inf
    return Trial(model, held_out, np.nan_to_num(errors, nan=0.0), (cameras[0], cameras[1]), found)


def _solved(estimate: Estimate, seen: Observations) -> Camera:
    """Solves the camera from these views only, starting from the result of all views."""
    start = with_views(estimate.cameras[0], seen)
    return adjust_views(start, seen, Unknowns.all_of(start), iterations=25).cameras[0]


def _tried(camera: Camera, seen: Observations) -> Array:
    """Returns the error (V,) [px] of each view with the camera fixed and the board's poses adjusted, robust to
    outliers."""
    start = with_views(camera, seen)
    found = adjust_views(start, seen, Unknowns.all_of(start, interior=False), huber=3.0, iterations=15)
    squared = (found.residuals_px(seen) ** 2).sum(1)
    views = int(seen.view.max()) + 1
    return np.array([np.sqrt(np.median(squared[seen.view == v]) / np.log(2)) for v in range(views)])
