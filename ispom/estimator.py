"""The estimator contract, and what a method is. State is a value: that gives rewind, fork and determinism."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.types import Check, Frame, Kind, Measurement, Rig, Step, Trajectory


class Estimator(Protocol):
    """Turns measurements into poses. Never prints, draws, logs, locks, or sees the ground truth."""

    def start(self) -> Any:
        """Returns the State before the first measurement: a frozen dataclass that nobody mutates."""
        ...

    def step(self, state: Any, measurement: Measurement, /) -> tuple[Any, Step]:
        """Returns the State after the measurement, and what happened. Same arguments, same result, bit for bit.

        It is given measurements of `Method.sensors` only, in the order of time.
        """
        ...

    def finish(self, state: Any, /) -> Trajectory:
        """Returns the best trajectory of all measurements so far (of `Step.frame`); the state can still be stepped on
        from."""
        ...


@runtime_checkable
class LeavesOut(Protocol):
    """An Estimator whose state can be had without some tracks, so that a step can be run again without them."""

    def without_tracks(self, state: Any, ids: NDArray[np.int64], /) -> Any:
        """Returns the state without the tracks `ids` (M,), their points and their observations. What was marginalised
        of them stays in priors."""
        ...


class Integrator(Protocol):
    """The same for an estimator that depends on others: it is given their results by role (see Method.asks)."""

    def start(self) -> Any: ...

    def step(self, state: Any, measurement: Measurement, inputs: Mapping[str, Step], /) -> tuple[Any, Step]:
        """`inputs` holds the Steps of those that use this measurement."""
        ...

    def finish(self, state: Any, inputs: Mapping[str, Trajectory], /) -> Trajectory:
        """`inputs` holds the best trajectories of all that it depends on."""
        ...


class MethodConfig(Protocol):
    """A frozen dataclass: defaults that work, below each field its docstring, a `Range` in its type."""

    def build(self, rig: Rig) -> Estimator | Integrator: ...


@dataclass(frozen=True, eq=False, repr=False)
class Method:
    """What the registry holds of a method."""

    name: str
    """Its identity everywhere: flags, colours, files, entity paths. The paper's end in `.paper`."""
    sensors: frozenset[Kind]
    """The kinds of measurements that it uses: `video`, `stereo`, `imu`, `gnss`, ... It is given these only."""
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
    optional: frozenset[Kind] = frozenset()
    """Those of `sensors` that it can do without where the rig lacks them."""
    survey: str = ""
    """The row of the paper's survey that it stands for, as in "Table 3, one camera: direct"; such a method runs only
    where it is chosen by name. Empty: no method of the survey."""
    world: Literal["start", "own"] = "start"
    """Where its world is. start: at the first pose of the rig, or of the only camera; own: elsewhere, such as at a tag
    or where a GNSS has its origin."""

    def __repr__(self) -> str:
        return f"Method({self.name}: of {' and '.join(sorted(self.sensors))}; {self.unit} unit; {self.source})"

    def uses(self, measurement: Measurement) -> bool:
        """Checks that the method steps on the measurement."""
        return measurement.kind in self.sensors

    def missing(self, rig: Rig) -> list[Kind]:
        """Returns the kinds of sensors that it requires and the rig lacks, sorted."""
        return sorted(kind for kind in self.sensors - self.optional if not rig.has(kind))

    def possible(self, rig: Rig) -> bool:
        """Checks that the rig has the sensors that it requires."""
        return not self.missing(rig)


VIDEO: frozenset[Kind] = frozenset({"video"})
STEREO: frozenset[Kind] = frozenset({"stereo"})
TRANSFER, PER_UNIT = "scale transfer factor", "m per unit"
"""Meanings of Step.scale (Method.scale)."""


def require_frame(
    measurement: Measurement, kinds: frozenset[Kind], last_ns: int | None = None, rig: Rig | None = None
) -> Frame:
    """Returns the measurement as a frame that an estimator can step on.

    Raises InputError where it is of none of the `kinds`, not later than the last frame of its kind, or has an image of
    another size than its camera of the `rig`.
    """
    if not isinstance(measurement, Frame) or measurement.kind not in kinds:
        expected = " or ".join(f"{kind} frames" for kind in sorted(kinds))
        raise InputError(f"this method steps on {expected}, not on a measurement of the kind {measurement.kind!r}")
    if last_ns is not None and measurement.time_ns <= last_ns:
        raise InputError(
            f"a {measurement.kind} frame at {measurement.time_ns} ns is not later than the one before it, at "
            f"{last_ns} ns: correct the times of the sequence"
        )
    cameras = {} if rig is None else rig.cameras
    for name in measurement.images.keys() & cameras.keys():
        camera, (height, width) = cameras[name], measurement.images[name].shape[:2]
        if (width, height) != (camera.width, camera.height):
            raise InputError(
                f"the {name} image at {measurement.time_ns} ns has {width} x {height} pixels, and its camera "
                f"{camera.width} x {camera.height}: give images of that size, or the calibration of these"
            )
    return measurement
