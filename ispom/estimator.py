"""The estimator contract, and what a method is. State is a value: that gives rewind, fork and determinism."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from ispom.types import Check, Exposure, Kind, Rig, Step, Trajectory, VideoFrame


class Estimator(Protocol):
    """Turns exposures into poses. Never prints, draws, logs, locks, or sees the truth."""

    def start(self) -> Any:
        """The State before the first exposure: a frozen dataclass that nobody mutates."""
        ...

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        """The State after the exposure, and what happened. Same arguments, same result, bit for bit."""
        ...

    def finish(self, state: Any) -> Trajectory:
        """The best trajectory of all exposures so far (of `Step.frame`); the state can still be stepped on from."""
        ...


class Integrator(Protocol):
    """The same for an estimator that builds on others: it is given what they said, by role (see Method.asks)."""

    def start(self) -> Any: ...

    def step(self, state: Any, exposure: Exposure, asked: Mapping[str, Step]) -> tuple[Any, Step]:
        """`asked` holds the Steps of those that use this exposure."""
        ...

    def finish(self, state: Any, asked: Mapping[str, Trajectory]) -> Trajectory:
        """`asked` holds the best trajectories of all that it asks."""
        ...


class MethodConfig(Protocol):
    """A frozen dataclass: defaults that work, below each field its docstring, a `Range` in its type."""

    def build(self, rig: Rig) -> Estimator | Integrator: ...


@dataclass(frozen=True, eq=False)
class Method:
    """What the registry holds of a method."""

    name: str
    """Its identity everywhere: flags, colours, files, entity paths. The paper's end in `.paper`."""
    needs: frozenset[Kind]
    """The kinds of exposures that it steps on."""
    config: type
    """A MethodConfig."""
    unit: Literal["metric", "own"]
    """Whether its trajectory is in metres or in a unit of its own."""
    source: str
    """The paper's section, or a reference."""
    scale: str = "scale factor"
    """What Step.scale means, with its unit."""
    asks: Mapping[str, str] = field(default_factory=dict)
    """Role -> name of each method whose Steps it builds on; those are computed once for all who ask."""
    checks: Mapping[str, Check] = field(default_factory=dict)
    """By key: all that its Decisions may be about."""
    stages: Mapping[str, str] = field(default_factory=dict)
    """By their names in Step.seconds: what is done in each stage, one sentence for people."""

    def uses(self, exposure: Exposure) -> bool:
        return ("video" if isinstance(exposure, VideoFrame) else "stereo") in self.needs

    def possible(self, rig: Rig) -> bool:
        """Whether the rig has the cameras."""
        return ("video" not in self.needs or rig.video is not None) and ("stereo" not in self.needs or rig.has_stereo)
