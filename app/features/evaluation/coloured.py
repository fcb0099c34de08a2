"""A quantity along the compared poses of an estimate, for the colours of its path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.evaluation.comparison import local_scale
from ispom.geometry import Array

from ...engine.run_folder.step_reader import stored_steps
from .evaluated import Evaluated

SAME_MOMENT_S = 1e-3
"""Largest difference of the times of a pose and of its row in steps.csv [s]: TUM files have microseconds."""


def _scale(item: Evaluated) -> Array:
    """The local scale between the middles of its windows; beyond the outer ones it is unknown."""
    local, times_ns = local_scale(item.found), item.found.reference.times_ns
    if not local["times_ns"]:
        return np.full(len(times_ns), np.nan)
    middles = np.asarray(local["times_ns"], np.int64) - times_ns[0]
    return np.interp(times_ns - times_ns[0], middles, local["scale"], left=np.nan, right=np.nan)


def _speed(item: Evaluated) -> Array:
    """Speed of the estimate, aligned, from each compared pose to the next one; the last one has that before it."""
    steps = np.linalg.norm(np.diff(item.found.estimate.translations, axis=0), axis=1)
    speeds = steps / (np.maximum(np.diff(item.found.reference.times_ns), 1) * 1e-9)
    return np.append(speeds, speeds[-1:])


OWN: Mapping[str, tuple[str, Callable[[Evaluated], Array]]] = {
    "position-error": ("position error [m]", lambda item: item.found.position_errors),
    "rotation-error": ("rotation error [deg]", lambda item: item.found.rotation_errors_deg),
    "scale": ("local scale", _scale),
    "speed": ("speed [m/s]", _speed),
}
"""Title and values (N,) at the compared poses, by the name that `--colour-by` takes."""


def along(item: Evaluated, name: str) -> tuple[str, Array]:
    """Returns the title and the values (N,), NaN where unknown, of a quantity at the N compared poses.

    A name that is not in `OWN` is a column or check of the estimate's method in the steps.csv beside its file. Raises
    InputError where there is no such quantity, with the names of those that there are.
    """
    if name in OWN:
        title, of = OWN[name]
        return title, np.asarray(of(item), float)
    return name, _of_steps(item, name)


def _of_steps(item: Evaluated, name: str) -> Array:
    folder, method = item.file.path.parent, item.file.path.stem
    own = f"--colour-by takes {', '.join(OWN)}, or a number of steps.csv where the estimate is a method's file in a run"
    if not Path(folder / "steps.csv").is_file():
        raise InputError(f"'{name[:60]}' is unknown of {item.file.path}, which has no steps.csv beside it: {own}")
    times, values, seen = list[int](), list[float](), set[str]()
    with stored_steps(folder) as steps:
        for step in steps:
            if step.method == method:
                numbers = {k: v for k, v in step.values.items() if isinstance(v, int | float)}
                seen |= numbers.keys()
                times.append(step.time_ns)
                values.append(float(numbers.get(name, np.nan)))
    if name not in seen:
        plain = sorted(key for key in seen if "." not in key)  # without the parts of checks, of which there are many
        known = f"it has {', '.join(plain)} of {method}" if seen else f"it has no step of {method}"
        raise InputError(f"'{name[:60]}' is no number in {folder / 'steps.csv'}: {known}; or give {', '.join(OWN)}")
    return _at(item.found.estimate.times_ns, np.array(times, np.int64), np.array(values))


def _at(wanted: np.ndarray, times: np.ndarray, values: Array) -> Array:
    """The values at the nearest of `times` (increasing), NaN where it is further away than `SAME_MOMENT_S`."""
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(times[before] - wanted) < np.abs(times[after] - wanted), before, after)
    return np.where(np.abs(times[nearest] - wanted) <= SAME_MOMENT_S * 1e9, values[nearest], np.nan)
