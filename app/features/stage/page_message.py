"""Where the eye of a page's 3-D view may stand: the page is sent what has changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ispom.geometry import Array, Similarity
from ispom.methods import method as registered

from ...engine.model.poses import PoseHistory, Times
from ...engine.model.true_path import TruePath
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.rerun.blueprint import EYE, least_size, page_layout
from ...views.rerun.eye import Eye, extent, eye_above, eye_behind, eye_from_side, eye_of, eye_on, is_framed
from ...views.web.news import Look, News
from ..integration.commands import IntegrationSteps
from ..integration.drawing import drawing, positions
from ..integration.integration import latest_fit
from ..layers.state import Layers

FOLLOWING = 0.25
"""Distance of the eye that follows a camera, relative to the extent of the path."""

LOOKED_BACK = 20
"""Frames among which the newest pose is looked for: without one for longer, there is no camera to go with."""


class StageNews(News):
    """What one page has. The eyes on all paths change only where a path has left what they frame."""

    def __init__(self) -> None:
        self._run: CurrentRun | None = None
        self._true_path: TruePath | None = None
        self._framed: Array | None = None
        self._shown: tuple[object, ...] = ()

    def of(self, look: Look) -> dict[str, Any]:
        found = self.since(look.local, look.run)
        return {} if found is None else {"stage": found}

    def since(self, state: State, run: CurrentRun | None) -> dict[str, Any] | None:
        """What is new to the page, which shows this state; None where nothing is."""
        if run is None or state.displayed is None or state.displayed.index >= len(run.history):
            return None
        steps = state[IntegrationSteps].shown
        shown = (run, state.displayed, steps, "truth" in state[Layers].undrawn)
        if shown == self._shown:
            return None
        self._shown = shown
        news: dict[str, Any] = {}
        if run is not self._run:
            self._run, self._framed, self._true_path = run, None, TruePath(run.opened)
            news |= {"eye": EYE, "layout": page_layout(run.opened)}
        if not run.opened.methods:  # of a recording alone no pose is known, and its layout has an eye of its own
            return news or None
        estimates, least = self._estimates(state, run, state.displayed.placements), least_size(run.opened)
        path = np.concatenate([estimates, self._truth(state, run, state.displayed.placements)])
        if self._framed is None or not is_framed(path, self._framed, least):
            self._framed = path
            eyes = {"frame": eye_on(path, least), "top": eye_above(path, least), "side": eye_from_side(path, least)}
            news |= {name: _values(eye) for name, eye in eyes.items()}
        distance = FOLLOWING * max(extent(estimates), least)
        return news | self._of_camera(state, run, state.displayed.placements, distance) or None

    def _estimates(self, state: State, run: CurrentRun, placements: Mapping[str, Similarity]) -> Array:
        """(N, 3) in the shared world: of all methods up to the frame shown, or of the integration that is looked at."""
        steps = state[IntegrationSteps].shown
        fit = latest_fit(run, steps.method, state.index) if steps is not None else None
        if steps is not None and fit is not None and (shapes := drawing(fit[1], steps.stage)):
            return positions(shapes)
        model, found = run.model, list[Array]([np.zeros((0, 3))])
        for method, known in model.methods.items():
            placement = placements.get(method, Similarity())
            found.append(placement.apply(_positions(known.poses, model.times, state.index)))
        return np.concatenate(found)

    def _truth(self, state: State, run: CurrentRun, placements: Mapping[str, Similarity]) -> Array:
        """(N, 3) the true path, where it is drawn; where it is aligned to the estimates, as far as these go: beyond,
        an alignment to a few poses leads anywhere."""
        truth, shown, nothing = run.opened.truth, state.displayed, np.zeros((0, 3))
        if truth is None or shown is None or self._true_path is None or state[IntegrationSteps].shown is not None:
            return nothing
        if "truth" in state[Layers].undrawn:
            return nothing
        placed = self._true_path.at(run.model, placements)
        if placed is None:
            return nothing
        known = slice(None) if self._true_path.fixed else truth.times_ns <= shown.time_ns
        return placed.apply(truth.translations[known])

    def _of_camera(
        self, state: State, run: CurrentRun, placements: Mapping[str, Similarity], distance: float
    ) -> dict[str, Any]:
        """The eyes that go with the camera, of the method that needs most sensors."""
        rig, methods = run.opened.sequence.rig, run.opened.methods
        if not methods or (rig.video or rig.left) is None:
            return {}
        method = max(methods, key=lambda m: len(registered(m).sensors))
        steps = (s for i in range(state.index, max(state.index - LOOKED_BACK, -1), -1) for s in run.history[i].steps)
        step = next((s for s in steps if s.method == method and s.world_from_frame is not None), None)
        if step is None or step.world_from_frame is None:
            return {}
        camera = "video" if rig.video is not None else "left"
        own = step.world_from_frame @ rig.rig_from(step.frame).inverse() @ rig.rig_from(camera)
        pose = placements.get(method, Similarity()).apply_pose(own)
        return {"camera": _values(eye_of(pose, distance)), "follow": _values(eye_behind(pose, distance))}


def _positions(poses: PoseHistory, times: Times, index: int) -> Array:
    """(N, 3) of all known poses up to a frame."""
    known = np.concatenate([np.zeros(0, bool), *(block.known for block in poses.blocks)])
    xyz = np.concatenate([np.zeros((0, 3)), *(block.positions for block in poses.blocks)])
    count = times.rows_until(index)
    return xyz[:count][known[:count]]


def _values(eye: Eye) -> list[list[float]]:
    """Position, target and up, as the page gives them to the viewer."""
    return [[round(float(x), 5) for x in part] for part in (eye.position, eye.target, eye.up)]


NEWS = (StageNews,)
