"""A run that is taken frame by frame: stopped, taken back, forked."""

from __future__ import annotations

from collections import deque
from typing import Any

from ispom.ensemble import Ensemble
from ispom.errors import InputError
from ispom.notebook.result import MAX_MB
from ispom.notebook.run import RATE_HZ, Source, built, opened
from ispom.notebook.run_folders import run_folders
from ispom.types import Rig, Sequence, Step, Trajectory

WINDOW = 10


def stepper(
    source: Source,
    name: str,
    *,
    window: int = WINDOW,
    rig: Rig | None = None,
    rate_hz: float = RATE_HZ,
    **settings: Any,
) -> Stepper:
    """Returns an iterator over the steps of a method: `for step in ispom.stepper(sequence, "stereo"): ...`.

    It can go back by up to `window` frames. `source`, `rig`, `rate_hz` and `settings` as of `ispom.run`.
    """
    if isinstance(window, bool) or not isinstance(window, int) or window < 0:
        raise InputError(f"window is {str(window)[:40]!r}: give the number of frames that can be taken back")
    sequence = opened(source, rig, rate_hz)
    ensemble = built(sequence, name, settings)
    return Stepper(sequence, name, dict(settings), ensemble, deque([(0, ensemble.start())], window + 1))


class Stepper:
    """A place in a run. Taking the next step is computing; not taking it is stopping."""

    def __init__(
        self,
        sequence: Sequence,
        name: str,
        settings: dict[str, Any],
        ensemble: Ensemble,
        states: deque[tuple[int, dict[str, Any]]],
    ) -> None:
        """`states`: the number of the next frame and the state before it, the newest last."""
        self.sequence, self.method, self.settings = sequence, name, settings
        self._ensemble, self._states = ensemble, states
        self._views: list[Any] = []

    @property
    def frame(self) -> int:
        """The number of the next frame."""
        return self._states[-1][0]

    @property
    def state(self) -> dict[str, Any]:
        """By method that runs, its state, which nobody changes."""
        return dict(self._states[-1][1])

    @property
    def trajectory(self) -> Trajectory:
        """The best one of all frames so far."""
        return self._ensemble.finish(self._states[-1][1])[self.method]

    def __iter__(self) -> Stepper:
        return self

    def __next__(self) -> Step:
        """The step at the next frame that the method uses."""
        frame, state = self._states[-1]
        while frame < len(self.sequence):
            measurement = self.sequence[frame]
            state, steps = self._ensemble.step(state, measurement)
            frame += 1
            own = next((step for step in steps if step.method == self.method), None)
            if own is not None:
                self._states.append((frame, state))
                for view in self._views:
                    view.add(frame - 1, own, measurement)
                return own
        raise StopIteration

    def back(self, steps: int = 1) -> None:
        """Goes back by `steps` steps; the next step then has the same result again. Raises InputError beyond the
        window."""
        if not 0 <= steps < len(self._states):
            raise InputError(
                f"back({steps}): {len(self._states) - 1} steps are kept; give stepper(..., window=N) for more"
            )
        for _ in range(steps):
            self._states.pop()
        for view in self._views:
            view.drop(self.frame)

    def show(self, *, max_mb: float = MAX_MB) -> Any:
        """Returns a view for a cell, as of `Run.show`, that follows: each next step comes into it, and what is taken
        back leaves it. It has the steps from now on, of them the latest that `max_mb` MB have room for."""
        view = run_folders().show(self, None, max_mb)
        self._views.append(view)
        return view

    def fork(self, **settings: Any) -> Stepper:
        """Returns another stepper that goes on from here, with other settings where some are given."""
        changed = self.settings | settings
        ensemble = built(self.sequence, self.method, changed)
        return Stepper(self.sequence, self.method, changed, ensemble, deque(self._states, self._states.maxlen))

    def __repr__(self) -> str:
        return f"Stepper({self.method} of {self.sequence.name}: frame {self.frame} of {len(self.sequence)} is next)"
