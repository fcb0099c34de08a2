"""The results of the methods in a run, as columns and rows: its steps.csv and decisions.csv."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.methods import names
from ispom.types import Decision

from ...engine.history.step_quantities.step import DROPPED
from ...engine.run_folder.run_folder import STEPS
from ...engine.run_folder.step_reader import StoredStep, stored_steps

NUMBERS = ("error_m", "scale", "inliers", "residual_median_px", "alive", "new", *DROPPED, "seconds")


@dataclass(frozen=True, eq=False)
class Steps:
    """The results of one method at its N frames."""

    exposures: np.ndarray
    times_ns: np.ndarray
    status: tuple[str, ...]
    key_frame: np.ndarray
    columns: Mapping[str, np.ndarray]
    """By name of NUMBERS: (N,), NaN where there is no value."""
    stages: Mapping[str, np.ndarray]
    """By stage: (N,) seconds, 0 where it was not run."""

    @property
    def dropped(self) -> np.ndarray:
        """(N,) tracks that ended."""
        return np.sum([self.columns[name] for name in DROPPED], axis=0)


@dataclass(frozen=True)
class DecisionRow:
    """One decision, and when."""

    exposure: int
    time_ns: int
    method: str
    decision: Decision


def read_steps(folder: Path) -> tuple[dict[str, Steps], tuple[DecisionRow, ...]]:
    """By method, in the order of the registry, and all decisions in the order of the files; InputError names the line
    that is wrong."""
    found: dict[str, list[StoredStep]] = {name: [] for name in names()}
    decisions: list[DecisionRow] = []
    with stored_steps(folder) as steps:
        for step in steps:
            if step.method not in found:
                raise InputError(f"{folder / STEPS} names a method {step.method[:40]!r} that is not installed")
            found[step.method].append(step)
            decisions += (DecisionRow(step.exposure, step.time_ns, step.method, d) for d in step.decisions)
    return {name: _columns(rows) for name, rows in found.items() if rows}, tuple(decisions)


def _columns(steps: list[StoredStep]) -> Steps:
    stages = dict.fromkeys(stage for step in steps for stage in step.seconds)
    return Steps(
        np.array([step.exposure for step in steps], np.int64),
        np.array([step.time_ns for step in steps], np.int64),
        tuple(str(step.values["status"]) for step in steps),
        np.array([step.values["key_frame"] for step in steps], bool),
        {name: np.array([_number(step, name) for step in steps]) for name in NUMBERS},
        {stage: np.array([step.seconds.get(stage, 0.0) for step in steps]) for stage in stages},
    )


def _number(step: StoredStep, name: str) -> float:
    """NaN where there is no value."""
    value = step.values[name]
    return math.nan if value is None else float(value)
