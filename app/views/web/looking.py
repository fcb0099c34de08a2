"""What one page looks at by itself while somebody else controls the session: nothing of the shared run changes.

Used in the loop of the server alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ispom.errors import InputError

from ...session import commands as do
from ...session import moves
from ...session.current_run import CurrentRun
from ...session.state import Changed, Displayed, Event, FeatureChanged, NoticeAdded, State

MAX_SPEED_HZ = 120
"""Frames a second of "as fast as possible": eyes follow no faster."""
PLAYING_S = 0.03
"""Between two looks at the clock while it plays."""
OF_A_RUN = ("displayed", "playing", "loop")
"""What means nothing in another run; the rest stays."""


class Looking:
    """One page's own values of some fields of the state. `version` changes with them."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._own: dict[Any, Any] = {}
        """By field of the core, or by feature."""
        self._run = -1
        self._began = (0.0, 0)
        """When the local playback began, and at which frame."""
        self.version = 0

    @property
    def index(self) -> int | None:
        """The frame that the page looks at; None while it follows the session."""
        return self._own["displayed"].index if "displayed" in self._own else None

    @property
    def playing(self) -> bool:
        return self._own.get("playing", False)

    def follow(self) -> None:
        """From now on the page shows what the session shows."""
        if self._own:
            self._own = {}
            self.version += 1

    def shown(self, state: State) -> State:
        """The session's state with the page's own values; the session's itself where it has none."""
        if state.run != self._run:
            self._run = state.run
            if any(name in self._own for name in OF_A_RUN):
                self._own = {name: value for name, value in self._own.items() if name not in OF_A_RUN}
                self.version += 1
        if not self._own or state.phase != "ready":
            return state
        core = {name: value for name, value in self._own.items() if isinstance(name, str)}
        core |= {"target": None} if "displayed" in self._own else {}
        features = [value for name, value in self._own.items() if not isinstance(name, str)]
        return replace(state, **core).having(*features)

    def obey(self, command: object, state: State, run: CurrentRun | None) -> bool:
        """Does what only looks, and returns whether it was that. InputError where there is nothing to look at."""
        if not (isinstance(command, do.Moves) or (isinstance(command, do.Command) and command.only_looks)):
            return False
        if run is None or state.phase != "ready" or not len(run.history):
            raise InputError("there is no frame to look at yet: wait for the first one")
        here = self.shown(state)
        match command:
            case do.Speed(factor):
                self._own["speed"] = factor
            case do.NoLoop():
                self._own["loop"] = None
            case do.LoopEdge(edge):
                self._take(moves.loop_edge(here, edge))
            case do.SetLoop(start, end):
                self._take(moves.set_loop(here, start, end))
            case do.Play(on):
                self._play(here, run, not here.playing if on is None else on)
            case do.StepBy(count):
                self._show(run, here.index + count)
            case do.Seek(index):
                self._show(run, index)
            case do.GoToEnd():
                self._show(run, len(run.history) - 1)
            case do.StepTo(kind, forwards):
                self._take(moves.step_to(here, run, kind, forwards=forwards))
            case _:
                self._take(command.look(here, run))
        self._began = (self._clock(), self.shown(state).index)
        self.version += 1
        return True

    def turn(self, state: State, run: CurrentRun | None) -> None:
        """Goes on with the local playback, within the frames that are computed."""
        here = self.shown(state)
        if not self.playing or run is None or "displayed" not in self._own:
            return
        first, last = 0, len(run.history) - 1
        if here.loop is not None:
            first, last = here.loop.start, last if here.loop.end is None else min(here.loop.end, last)
        began_s, began = self._began
        index = _at(run.playback.sequence.times_ns, began, self._clock() - began_s, here.speed)
        if index > last or (index == last == here.index):
            if here.loop is not None and first < last:
                index = first if here.index >= last else last
            elif not (state.playing or state.target is not None):
                self._own["playing"] = False
                self.version += 1
            index = min(index, last)
            self._began = (self._clock(), index)
        if index != here.index:
            self._own["displayed"] = run.history[index]
            self.version += 1

    def _play(self, here: State, run: CurrentRun, on: bool) -> None:
        last = len(run.history) - 1 if here.loop is None or here.loop.end is None else here.loop.end
        if on and here.index >= min(last, len(run.history) - 1):
            self._show(run, 0 if here.loop is None else here.loop.start)
        else:
            self._show(run, here.index)
        self._own["playing"] = on

    def _show(self, run: CurrentRun, index: int) -> None:
        """Pauses, and shows a computed frame, the nearest one to `index`."""
        self._own |= {"displayed": run.history[min(max(index, 0), len(run.history) - 1)], "playing": False}

    def _take(self, events: tuple[Event, ...]) -> None:
        """The page's own values after these events. InputError where something would have to be computed, or where all
        that comes of it is a notice."""
        if len(events) == 1 and isinstance(events[0], NoticeAdded):
            raise InputError(events[0].text)
        for event in events:
            if isinstance(event, Displayed):
                self._own |= {"displayed": event.record, "playing": False}
            elif isinstance(event, FeatureChanged):
                self._own[type(event.value)] = event.value
            elif isinstance(event, Changed):
                if event.values.get("target") is not None:
                    raise InputError("there is none among the frames that are computed: look at it later")
                self._own |= {name: value for name, value in event.values.items() if name == "loop"}


def _at(times_ns: np.ndarray, began: int, elapsed_s: float, speed: float | None) -> int:
    """The frame after so much playing from frame `began` on."""
    if speed is None:
        return began + int(elapsed_s * MAX_SPEED_HZ)
    until_ns = int(times_ns[began]) + round(elapsed_s * speed * 1e9)
    return max(int(np.searchsorted(times_ns, until_ns, side="right")) - 1, began)
