"""viser's own 3-D scene: light, and the one that answers clicks. Paths, the poses now, key frames, a thin cloud."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import viser

from ispom.geometry import Similarity
from ispom.types import Step

from ...engine.events import Opened
from ...engine.history.record import ExposureRecord
from ...engine.model.run_model import RunModel
from ...engine.model.true_path import TruePath
from ...features.branches.branches import Beside
from ...features.branches.scene import BranchScene
from ...features.flicker.flicker import Flicker
from ...features.flicker.scene import FlickerScene
from ...features.integration.scene import IntegrationScene
from ...features.mapping.scene import MapScene
from ...presentation import colours
from ...session.current_run import CurrentRun
from .beside_scene import BesideScene
from .method_scene import MethodScene, add_line

TRUE_LINE = "/truth/line"


class Scene:
    """Draws the run as of one exposure. What did not change since it was drawn last is not sent again."""

    def __init__(
        self,
        api: viser.SceneApi,
        seek: Callable[[int], None],
        run_of: Callable[[int], CurrentRun | None] = lambda _: None,
    ) -> None:
        """`run_of` gives the run of a branch."""
        self._api, self._seek, self._run_of = api, seek, run_of
        self._methods: dict[str, MethodScene] = {}
        self._truth: viser.FrameHandle | None = None
        self._opened: Opened | None = None
        self._true_path: TruePath | None = None
        self._truth_placed: Similarity | None = None
        self._branches = BranchScene(api)
        self._beside: BesideScene | None = None
        self._map = MapScene(api, None)
        self._flicker, self._integration = FlickerScene(api, run_of, seek), IntegrationScene(api)

    def start(self, opened: Opened) -> None:
        """Empties the scene for another run."""
        self._api.reset()
        self._api.set_up_direction("-y")
        self._truth = self._api.add_frame("/truth", show_axes=False)
        self._opened, self._true_path, self._truth_placed = opened, TruePath(opened), None
        if self._true_path.fixed:
            self._place_truth(Similarity())
        self._methods = {m: MethodScene(self._api, m, opened, self._seek) for m in opened.methods}
        self._branches, self._beside = BranchScene(self._api), BesideScene(self._api, opened)
        self._map = MapScene(self._api, opened.map)
        self._flicker = FlickerScene(self._api, self._run_of, self._seek)
        self._integration = IntegrationScene(self._api)

    def show(self, model: RunModel, record: ExposureRecord, hidden: frozenset[str]) -> None:
        """The run as of an exposure: what was known then, without the hidden layers and methods."""
        if self._truth is not None:
            self._truth.visible = "truth" not in hidden
            self._draw_truth(model, record)
        for name, method in self._methods.items():
            placement = record.placements.get(name, Similarity())
            method.show(model.times, model.methods[name], placement, record.index, hidden)
            status = record.statuses.get(name)
            method.mark(provisional=status is not None and status.provisional)
        if self._beside is not None:
            self._beside.show(model, record, hidden)
        self._map.show(hidden)

    def _draw_truth(self, model: RunModel, record: ExposureRecord) -> None:
        """The true path where it is known now, in a line that is drawn again where it was aligned again."""
        if self._opened is None or self._true_path is None or self._opened.truth is None or self._true_path.fixed:
            return
        ended = record.index + 1 >= len(self._opened.sequence)
        found = self._true_path.at(model, record.placements, ended=ended)
        if found is not self._truth_placed:
            self._place_truth(found)

    def _place_truth(self, found: Similarity | None) -> None:
        """`found`: shared world from the truth's; None where that is not known."""
        self._truth_placed = found
        assert self._opened is not None and self._opened.truth is not None
        if found is None:
            self._api.remove_by_name(TRUE_LINE)
        elif len(self._opened.truth) > 1:
            add_line(self._api, TRUE_LINE, found.apply(self._opened.truth.translations), colours.TRUTH)

    def show_flicker(self, flicker: Flicker | None, index: int, hidden: frozenset[str]) -> None:
        """The two sides of a flicker, as of an exposure."""
        self._flicker.show(flicker, index, hidden)

    def turn(self, flicker: Flicker | None) -> None:
        """The side of the flicker that is seen."""
        self._flicker.turn(flicker)

    def show_integration(self, step: Step | None, stage: int) -> None:
        """A stage of a fit."""
        self._integration.show(step, stage)

    def show_beside(self, branches: Mapping[int, Beside], hidden: frozenset[str]) -> None:
        """Other branches, as of the same exposure."""
        self._branches.show(branches, hidden)
