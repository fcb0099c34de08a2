"""The declaration of a kind of sensor: everything that the program needs of it stands in one class."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array
from ispom.plausibility import Doubt
from ispom.plausibility.times import ANY_RATE, BEFORE_NS, Rates
from ispom.sensors.fusion import Factor, GraphFrames, Node, NodeContext, Variable
from ispom.types import Check, Kind, Measurement, Sensor, TimedPoints


@dataclass(frozen=True, eq=False)
class Table:
    """A file of measurements: numbers by the names of their columns."""

    path: Path
    times_ns: NDArray[np.int64]
    """(N,) strictly increasing."""
    columns: Mapping[str, Array]

    def stacked(self, names: tuple[str, ...]) -> Array:
        """Returns columns (N, K). Raises InputError for one that the file lacks."""
        if missing := [name for name in names if name not in self.columns]:
            known = ", ".join(self.columns) or "none but the time"
            raise InputError(f"{self.path} has no column {missing[0]} (it has {known}): name it in `columns`")
        return np.stack([self.columns[name] for name in names], axis=1)

    def has(self, names: tuple[str, ...]) -> bool:
        return all(name in self.columns for name in names)


@dataclass(frozen=True, eq=False)
class FileOptions:
    """What an entry of a `sensors.yaml` says about its file."""

    where: str
    """The entry or the file, which begins messages."""
    sigma_m: float | None = None
    """Standard deviation of positions [m]; None: that of the file."""
    origin: Array | None = None
    """(3,) latitude, longitude [deg] and height [m] of the local frame; None: the first position."""
    scan_s: float = 0.0
    """Time from the first beam of a scan to the last [s]."""


@dataclass(frozen=True, eq=False)
class Readings:
    """All measurements of one sensor, in the order of time."""

    kind: Kind
    times_ns: NDArray[np.int64]
    """(N,); where measurements are `between` times (N + 1,), the begin of the first one being the first."""
    values: Mapping[str, Array] = field(default_factory=dict)
    """(N, ...) by the names of the kind; of scans, arrays of all their points; of kinds that are not read from files
    nothing."""
    between: bool = False
    """Whether each measurement spans the time from the one before."""

    def __len__(self) -> int:
        return max(len(self.times_ns) - self.between, 0)

    @property
    def ends_ns(self) -> NDArray[np.int64]:
        """(N,) when each was complete."""
        return self.times_ns[int(self.between) :]

    def within(self, frames_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Returns (N,) which measurements lie within the time of the frames (M,), or shortly before."""
        return (self.ends_ns >= frames_ns[0] - BEFORE_NS) & (self.ends_ns <= frames_ns[-1])


class SensorKind:
    """A kind of sensor. A module of it has a subclass, and one instance of that as its `KIND`.

    The methods about files have defaults for a sensor whose measurements are numbers: the columns of its tables have
    the names of the fields of the measurement.
    """

    name: Kind = ""
    """In a rig.yaml, in addresses of simulations, and in the stream; `kind` of its Sensor and its Measurement."""
    label: str = ""
    """Of its row on the time axis and of its checks: "Wheels"."""
    phrase: str = ""
    """In sentences: "a wheel odometer"."""
    order: int = 100
    """Kinds are listed by this, built-in ones first."""
    sensor: type[Sensor]
    """Its entry in the rig: a pose and noises. The fields of this class are the entries of a rig.yaml."""
    measurement: type[Measurement]
    """A dataclass of a time, values, and the name of the sensor in the rig, in `sensor`."""

    has_files: bool = True
    """Whether tables of it are read, and all its measurements are small enough to be loaded together."""
    takes_points: bool = False
    """Whether files of points with times are read, too."""
    rates: Rates = ANY_RATE
    """Rates of its measurements, by which a wrong unit of times is recognised."""

    simulated: type | None = None
    """A `SimulatedSensor`, whose settings are those of addresses; None where it is not simulated."""

    measures: Literal["relative", "absolute"] | None = None
    """How `fused` uses it: as a motion since the node before, or as a value at a node; None: not at all."""
    tightly: bool = False
    """Whether `fused.tight` uses it, too."""
    makes_nodes: bool = False
    """Whether the graph has a node soon after each measurement."""
    needs: tuple[str, ...] = ()
    """Modules of the extra `fusion` that are needed besides gtsam."""
    variables: tuple[Variable, ...] = ()
    """Unknowns that each node has for this sensor, such as a bias."""
    checks: tuple[Check, ...] = ()
    """What its observations may decide, besides the misfit and the gain that each sensor has."""

    @property
    def word(self) -> str:
        """The label within a sentence: "IMU", "wheels"."""
        return self.label if self.label.isupper() else self.label.lower()

    # Files, and what is likely a mistake in them.

    def readings_of_points(self, points: TimedPoints) -> Readings:
        """Returns the readings of a file of points, of a kind that `takes_points`."""
        raise NotImplementedError

    def readings(self, table: Table, options: FileOptions) -> Readings:
        """Returns the readings of a table. Raises InputError that names what is wrong."""
        return Readings(self.name, table.times_ns, {name: table.stacked((name,))[:, 0] for name in self._fields})

    def collected(self, measured: Sequence[Any]) -> Readings:
        """Returns the readings of measurements of one sensor."""
        times_ns = np.array([m.time_ns for m in measured], np.int64)
        return Readings(self.name, times_ns, {k: np.array([getattr(m, k) for m in measured]) for k in self._fields})

    def measurements(self, found: Readings, frames_ns: NDArray[np.int64], name: str) -> Iterator[Measurement]:
        """Yields what a sensor of this name measured within the time of the frames (M,), in the order of time."""
        for i in np.flatnonzero(found.within(frames_ns)).tolist():
            values: dict[str, Any] = {key: column[i].item() for key, column in found.values.items()}
            yield self.measurement(int(found.times_ns[i]), **values, **{"sensor": name})

    def doubts(self, where: str, found: Readings) -> tuple[Doubt, ...]:
        """Returns doubts about the values; `where` begins their sentences."""
        return ()

    @property
    def _fields(self) -> list[str]:
        return [f.name for f in fields(self.measurement) if f.name not in ("time_ns", "sensor")]

    # The graph of `fused`: what waits becomes an observation of the next node, and that a factor.

    def remembered(self, memory: Any, measurement: Any, oldest_ns: int) -> Any:
        """Returns what waits for the next node after a measurement: all since a time, in order. `memory` is what
        waited before, None at first; it is never changed."""
        return (*(m for m in memory or () if m.time_ns >= oldest_ns), measurement)

    def observed(self, memory: Any, at: NodeContext) -> tuple[Any, Any]:
        """Returns the observation that belongs to a new node, None where there is none, and what goes on waiting."""
        raise NotImplementedError(type(self).__name__)

    def factors(self, before: Node | None, now: Node, frames: GraphFrames) -> list[Factor]:
        """Returns the factors of what was observed at a node, `now`, or since the one `before`. Of the first node of
        a window there is none before; of one whose absolute observations are used elsewhere, those are missing."""
        raise NotImplementedError(type(self).__name__)
