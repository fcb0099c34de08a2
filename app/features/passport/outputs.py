"""What the methods of a run gave: digests of it, and how far two runs of a method are from each other."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.geometry import rotation_angle_rad
from ispom.methods import method as registered
from ispom.types import Trajectory

from ...engine.history.quantities import POSE
from ...engine.history.quantity import Value
from ...engine.run_folder.digests import DIGESTS
from ...engine.run_folder.run_folder import trajectory_file
from ...engine.run_folder.step_reader import StoredStep, stored_steps
from ..report.folder import Run
from .written import Output

COLUMNS = ("status", *POSE, *DIGESTS)
"""Of steps.csv, after the number of the frame and its time: what is digested. Measured times are not."""


@dataclass(frozen=True)
class Spread:
    """How far the poses of two runs of a method are from each other."""

    common: int
    """Poses at the same time; the other figures are 0 where there are none."""
    others: int
    """Poses that only one of the runs has."""
    position: tuple[float, float]
    """The largest and the median distance, in the unit of the method."""
    rotation_deg: tuple[float, float]


def outputs(run: Run) -> tuple[Output, ...]:
    """Returns what each method of a run's folder gave, in the order of the registry. Raises InputError where a file is
    not as written."""
    steps, found = _Steps(run), list[Output]()
    for name in run.metrics:
        path = run.trajectories[name]
        if (digest := run.sha256.get(trajectory_file(name))) is None:
            raise InputError(f"{run.path} has no {trajectory_file(name)}: restore the file, or run again")
        found.append(
            Output(
                name,
                "metric" if registered(name).unit == "metric" else "own",
                len(path),
                digest,
                steps.digests[name].hexdigest(),
                path.length,
                _median(steps.sigmas[name, "sigma_position"]),
                _median(steps.sigmas[name, "sigma_deg"]),
                dict(run.metrics[name]),
            )
        )
    return tuple(found)


class _Steps:
    """What is taken of steps.csv, which is read once."""

    def __init__(self, run: Run) -> None:
        self.digests: dict[str, Any] = defaultdict(sha256)
        """By method."""
        self.sigmas: dict[tuple[str, str], list[float]] = defaultdict(list)
        """By method and key."""
        with stored_steps(run.path) as steps:
            for step in steps:
                self._add(step)

    def _add(self, step: StoredStep) -> None:
        cells = (step.exposure, step.time_ns, *map(step.values.get, COLUMNS))
        self.digests[step.method].update(f"{','.join(map(_cell, cells))}\n".encode())
        for key in ("sigma_position", "sigma_deg"):
            if isinstance(value := step.values[key], float):
                self.sigmas[step.method, key].append(value)


def _cell(value: Value) -> str:
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def spread(a: Trajectory, b: Trajectory) -> Spread:
    """Returns how far two runs are from each other, in the same world and unit, as the same method on the same frames
    begins in."""
    times_ns, at_a, at_b = np.intersect1d(a.times_ns, b.times_ns, return_indices=True)
    others = len(a) + len(b) - 2 * len(times_ns)
    if not len(times_ns):
        return Spread(0, others, (0.0, 0.0), (0.0, 0.0))
    away = np.linalg.norm(a.translations[at_a] - b.translations[at_b], axis=1)
    turned = np.degrees(rotation_angle_rad(a.rotations[at_a].transpose(0, 2, 1) @ b.rotations[at_b]))
    return Spread(
        len(times_ns),
        others,
        (float(away.max()), float(np.median(away))),
        (float(turned.max()), float(np.median(turned))),
    )
