"""A run folder, read with the place of every mistake. Nothing in it is trusted."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ispom.errors import InputError
from ispom.io.files import exists, sha256_of
from ispom.io.files import names as names_in
from ispom.io.rig import read_rig
from ispom.io.rows import read_text
from ispom.io.trajectories import read_tum
from ispom.methods import names
from ispom.types import Rig, Trajectory

from ...engine.run_events.event import RunEvent
from ...engine.run_events.table import read_events
from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import DECISIONS, EVENTS, MARKER, STEPS, ended_early
from .steps import DecisionRow, Steps, read_steps

HASHED = (".yaml", ".tum", ".json", ".csv", ".rrd", ".npz")


@dataclass(frozen=True, eq=False)
class Run:
    """The content of a report about one run."""

    path: Path
    label: str
    """What a person calls it."""
    manifest: Mapping[str, Any]
    """run.yaml: plain values, lists of them, and mappings of those."""
    metrics: Mapping[str, Mapping[str, Any]]
    """metrics.json, by method, in the order of the registry."""
    path_length_m: float | None
    rig: Rig
    trajectories: Mapping[str, Trajectory]
    """By method: world_from_FRAME, each in its own world."""
    truth: Trajectory | None
    """World_from_FRAME."""
    steps: Mapping[str, Steps]
    """steps.csv by method; empty where the folder has none."""
    decisions: tuple[DecisionRow, ...]
    """decisions.csv, in its order."""
    sha256: Mapping[str, str]
    """By file name."""
    events: tuple[RunEvent, ...] | None = None
    """events.csv; None where the folder has none."""

    @property
    def first_ns(self) -> int:
        """The time of the first frame, where the folder has it."""
        times = [s.times_ns[:1] for s in self.steps.values()]
        times += [t.times_ns[:1] for t in (*self.trajectories.values(), self.truth) if t is not None]
        return int(min((t[0] for t in times if len(t)), default=0))

    def seconds(self, times_ns: np.ndarray) -> np.ndarray:
        """Since the first frame [s]."""
        return (times_ns - self.first_ns) * 1e-9


def read_run(path: Path, label: str) -> Run:
    """InputError where the folder holds no run, one that was killed or goes on, or files that are not as written.
    Of a run that ended early, how far it came is among the notes of its manifest."""
    found = read_run_file(path)
    said = ended_early(path)
    if exists(path / MARKER) and not said:
        why = read_text(path / MARKER).strip().splitlines()
        raise InputError(
            f"{path} holds a run that is not complete ({why[0] if why else 'no reason given'}): run it again"
        )
    metrics, length = _metrics(path / "metrics.json")
    frame = found.frame
    truth = read_tum(path / "truth.tum", frame) if exists(path / "truth.tum") else None
    steps, decisions = read_steps(path) if exists(path / STEPS) and exists(path / DECISIONS) else ({}, ())
    return Run(
        path,
        label,
        {**asdict(found), "notes": [*found.notes, *filter(None, [said])]},
        metrics,
        length,
        read_rig(path / "rig.yaml"),
        {method: read_tum(path / f"{method}.tum", frame) for method in metrics},
        truth if truth is not None and len(truth) else None,
        steps,
        decisions,
        {name: sha256_of(path / name) for name in names_in(path) if name.endswith(HASHED)},
        tuple(read_events(path / EVENTS)) if exists(path / EVENTS) else None,
    )


def _metrics(path: Path) -> tuple[dict[str, dict[str, Any]], float | None]:
    try:
        found = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        place = f" line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}{place} is not valid JSON: restore the file, or run again") from None
    methods = found.get("methods") if isinstance(found, dict) else None
    if not isinstance(methods, dict) or not all(isinstance(entry, dict) for entry in methods.values()):
        raise InputError(f"{path} has no methods as `ispom run` writes them: restore the file, or run again")
    if unknown := sorted(methods.keys() - set(names())):
        raise InputError(f"{path}: {unknown[0][:40]!r} is none of {', '.join(names())}: restore the file, or run again")
    length = found.get("path_length_m")
    return {m: methods[m] for m in names() if m in methods}, length if isinstance(length, int | float) else None
