"""What one page shows for itself while somebody else controls the session: nothing of the shared run changes.

The page moves by itself (static/place.js) and says here where it is; what features show otherwise, their commands say.
Used in the loop of the server alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec

from ispom.errors import InputError

from ...session.commands import Command
from ...session.current_run import CurrentRun
from ...session.state import FeatureChanged, FeatureState, Loop, State
from .messages import LookAt


class OwnPlace:
    """One page's own values of some fields of the state. `version` changes with them."""

    def __init__(self) -> None:
        self._core: dict[str, Any] = {}
        self._features: dict[type[FeatureState], FeatureState] = {}
        self._run = -1
        self.version = 0

    @property
    def index(self) -> int | None:
        """The frame that the page looks at; None while it follows the session."""
        return self._core["displayed"].index if "displayed" in self._core else None

    def follow(self) -> None:
        """From now on the page shows what the session shows."""
        if self._core or self._features:
            self._core, self._features = {}, {}
            self.version += 1

    def look_at(self, place: LookAt, run: CurrentRun | None) -> None:
        """The page is there now, at the nearest frame that is computed. Nothing happens without one."""
        if run is None or not len(run.history):
            return
        given = {name: value for name, value in msgspec.structs.asdict(place).items() if value is not msgspec.UNSET}
        index, loop = given.pop("index", None), given.get("loop")
        if index is not None:
            given["displayed"] = run.history[min(max(index, 0), len(run.history) - 1)]
        if loop is not None:
            given["loop"] = Loop(*loop)
        self._core = given
        self.version += 1

    def shown(self, state: State) -> State:
        """The session's state with the page's own values; the session's itself where it has none."""
        if state.run != self._run:
            self._run, self._core = state.run, {}  # it means nothing in another run; what features show does
        if not (self._core or self._features) or state.phase != "ready":
            return state
        core = self._core | ({"target": None} if "displayed" in self._core else {})
        return replace(state, **core).having(*self._features.values())

    def obey(self, command: Command, state: State, run: CurrentRun | None) -> bool:
        """Does what only looks, and returns whether it was that. InputError where it is not possible."""
        if not command.only_looks:
            return False
        if run is None or state.phase != "ready":
            raise InputError("there is no frame to look at yet: wait for the first one")
        for event in command.look(self.shown(state), run):
            if isinstance(event, FeatureChanged):
                self._features[type(event.value)] = event.value
        self.version += 1
        return True
