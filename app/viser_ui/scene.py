"""viser's own 3-D scene: light, and the one that answers clicks. Paths, the poses now, key frames, a thin cloud."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import viser

from ispom.geometry import Similarity

from .. import colours
from ..run.events import Opened
from ..run.history.record import ExposureRecord
from ..run.model.drawn_size import drawn_truth
from ..run.model.run_model import RunModel
from ..session.branching.branches import Beside
from .beside_scene import BesideScene
from .branch_scene import BranchScene
from .method_scene import MethodScene, add_line


class Scene:
    """Draws the run as of one exposure. What did not change since it was drawn last is not sent again."""

    def __init__(self, api: viser.SceneApi, seek: Callable[[int], None]) -> None:
        self._api, self._seek = api, seek
        self._methods: dict[str, MethodScene] = {}
        self._truth: viser.FrameHandle | None = None
        self._branches = BranchScene(api)
        self._beside: BesideScene | None = None

    def start(self, opened: Opened) -> None:
        """Empties the scene for another run."""
        self._api.reset()
        self._api.set_up_direction("-y")
        self._truth = self._api.add_frame("/truth", show_axes=False)
        truth = drawn_truth(opened.truth, opened.methods)
        if truth is not None and len(truth) > 1:
            add_line(self._api, "/truth/line", truth.translations, colours.TRUTH)
        self._methods = {m: MethodScene(self._api, m, opened, self._seek) for m in opened.methods}
        self._branches, self._beside = BranchScene(self._api), BesideScene(self._api, opened)

    def show(self, model: RunModel, record: ExposureRecord, hidden: frozenset[str]) -> None:
        """The run as of an exposure: what was known then, without the hidden layers and methods."""
        if self._truth is not None:
            self._truth.visible = "truth" not in hidden
        for name, method in self._methods.items():
            placement = record.placements.get(name, Similarity())
            method.show(model.times, model.methods[name], placement, record.index, hidden)
        if self._beside is not None:
            self._beside.show(model, record, hidden)

    def show_beside(self, branches: Mapping[int, Beside], hidden: frozenset[str]) -> None:
        """Other branches, as of the same exposure."""
        self._branches.show(branches, hidden)
