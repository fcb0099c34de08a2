"""The estimator contract. State is a value: that gives rewind, fork, determinism and easy tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Protocol

from ispom.types import Exposure, Step, Trajectory


class Estimator(Protocol):
    """Turns exposures into poses. Never prints, draws, logs, locks, or sees the truth."""

    @property
    def method(self) -> str:
        """Its name: monocular, stereo, integrated."""
        ...

    def uses(self, exposure: Exposure) -> bool:
        """Whether `step` wants exposures of this kind."""
        ...

    def start(self) -> Any:
        """The State before the first exposure: a frozen dataclass that nobody mutates."""
        ...

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        """The State after the exposure, and what happened. Same state and exposure, same result, bit for bit."""
        ...

    def finish(self, state: Any) -> Trajectory:
        """The best trajectory of all exposures so far (of `Step.frame`); the state can still be stepped on from."""
        ...


def run(estimator: Estimator, exposures: Iterable[Exposure]) -> Iterator[Step]:
    """Steps of the exposures that the estimator uses. Pull-based: pausing is not asking for the next."""
    state = estimator.start()
    for exposure in exposures:
        if estimator.uses(exposure):
            state, step = estimator.step(state, exposure)
            yield step
