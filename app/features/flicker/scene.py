"""The two sides of a flicker in viser's scene: both are drawn, one is visible, so that a key press shows the other."""

from __future__ import annotations

from collections.abc import Callable

import viser

from ispom.geometry import Similarity

from ...session.current_run import CurrentRun
from ...views.viser.method_scene import MethodScene
from .flicker import Flicker, Side

ROOT = "/flicker"


class FlickerScene:
    """Paths, key frames, points and poses of both sides."""

    def __init__(
        self, api: viser.SceneApi, run_of: Callable[[int], CurrentRun | None], seek: Callable[[int], None]
    ) -> None:
        self._api, self._run_of, self._seek = api, run_of, seek
        self._drawn: dict[Side, MethodScene] = {}

    def show(self, flicker: Flicker | None, index: int, hidden: frozenset[str]) -> None:
        """Both sides as known at an exposure."""
        wanted = (flicker.a, flicker.b) if flicker is not None else ()
        for side in self._drawn.keys() - set(wanted):
            self._drawn.pop(side).remove()
        for name, side in zip("ab", wanted, strict=False):
            run = self._run_of(side.branch)
            last = run.history.last if run is not None else None
            if run is None or last is None:
                continue
            at = min(index, last.index)
            if side not in self._drawn:
                root = f"{ROOT}/{name}{side.branch}_{side.method}"
                self._drawn[side] = MethodScene(self._api, side.method, run.opened, self._seek, root)
            known, placement = run.known_at(at), run.history[at].placements.get(side.method, Similarity())
            layers = hidden - {side.method}
            self._drawn[side].show(known.times, known.methods[side.method], placement, at, layers)
        self.turn(flicker)

    def turn(self, flicker: Flicker | None) -> None:
        """Which of them is seen."""
        for side, drawn in self._drawn.items():
            drawn.visible(flicker is not None and side == flicker.shown)
