"""viser's own 3-D scene: light, and the one that answers clicks. Paths, the poses now, key frames, a thin cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from ispom.geometry import Similarity
from ispom.types import Rig, Trajectory

from .. import colours
from ..run.events import Opened
from ..run.model import RunModel
from ..run.record import ExposureRecord
from .method_scene import MethodScene, add_line


class Scene:
    """Draws the run as of one exposure. What did not change since it was drawn last is not sent again."""

    def __init__(self, api: viser.SceneApi, seek: Callable[[int], None]) -> None:
        self._api, self._seek = api, seek
        self._methods: dict[str, MethodScene] = {}
        self._truth: viser.FrameHandle | None = None

    def start(self, opened: Opened) -> None:
        """Empties the scene for another run."""
        self._api.reset()
        self._api.set_up_direction("-y")
        self._truth = self._api.add_frame("/truth", show_axes=False)
        size = self._draw_truth(opened.truth)
        self._methods = {m: self._method(m, opened.sequence.rig, size) for m in opened.methods}

    def show(self, model: RunModel, record: ExposureRecord, hidden: frozenset[str]) -> None:
        """The run as of an exposure: what was known then, without the hidden layers and methods."""
        if self._truth is not None:
            self._truth.visible = "truth" not in hidden
        for name, method in self._methods.items():
            placement = record.placements.get(name, Similarity())
            method.show(model.times, model.methods[name], placement, record.index, hidden)

    def _method(self, name: str, rig: Rig, size: float) -> MethodScene:
        return MethodScene(self._api, name, colours.of(name), rig, size, self._seek)

    def _draw_truth(self, truth: Trajectory | None) -> float:
        """Depth of frusta [m], to the path's measure, where there is a true one."""
        if truth is None or len(truth) < 2:
            return 0.3
        add_line(self._api, "/truth/line", truth.translations, colours.TRUTH)
        return float(np.clip(np.linalg.norm(np.ptp(truth.translations, axis=0)) / 60, 0.05, 2.0))
