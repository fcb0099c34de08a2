"""The rows of the recordings folder. What is in it may be somebody else's: files are bounded, links not followed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args
from urllib.parse import quote

from ispom.errors import InputError
from ispom.evaluation.trajectory_error import Alignment, trajectory_error
from ispom.io.files import bounded, read_bytes
from ispom.io.mapping import read_mapping
from ispom.io.trajectories import read_tum

from ...engine.run_events.table import read_events
from ...engine.run_folder.run_file import RunFile
from ...engine.run_folder.run_folder import EVENTS, METRICS, RUN, TRUTH, trajectory_file
from ...presentation.texts import size
from ..experiments.command import PLAN
from ..recording.listing import described, list_recordings
from ..recording.state import ListedRun
from . import table
from .table import Row

MOST_BYTES = 4 << 20
"""Most bytes of a metrics.json or a plan."""
MOST = 1000
"""Runs that are looked at."""


class RecordedRuns:
    """The rows of one folder; a run is read again when one of its files has changed. Used by one thread at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[object, Row]] = {}

    @property
    def known(self) -> frozenset[str]:
        """The names of the runs and recordings that were found last."""
        return frozenset(self._known)

    def rows(self) -> list[Row]:
        """Of all finished runs, recordings, sweeps and experiments."""
        with bounded((self._folder,)):
            newest = [each for each in list_recordings(self._folder) if not _linked(self._folder, each.name)][:MOST]
            found = {each.name: self._row(each) for each in newest}
            self._known = {name: entry for name, entry in self._known.items() if name in found}
            rows = [self._with_parent(row, found) for row in found.values()]
            groups = [path.parent for path in self._folder.glob(f"*/{PLAN}") if not path.parent.is_symlink()]
            rows = table.under_groups(rows, (path.name for path in groups))
            return [*rows, *(row for path in groups if (row := _group(path, rows)) is not None)]

    def _row(self, listed: ListedRun) -> Row:
        path = self._folder / listed.name
        files = (path / RUN, path / METRICS, path / EVENTS) if path.is_dir() else (path,)
        version = (listed, tuple(map(_changed_ns, files)))
        if (known := self._known.get(listed.name)) is None or known[0] != version:
            known = version, _read(path, listed, max(filter(None, version[1]), default=0) / 1e9)
            self._known[listed.name] = known
        return known[1]

    def _with_parent(self, row: Row, keys: Mapping[str, Row]) -> Row:
        """A row still has the path of its origin as its parent."""
        return replace(row, parent=table.forked_parent(row.parent, (key for key in keys if key != row.key)))


def _read(path: Path, listed: ListedRun, when_s: float) -> Row:
    """A damaged run is still a row: it is there, and can be removed."""
    picture = f"pictures/{quote(listed.picture)}" if listed.picture else ""
    row = Row(listed.name, "run", listed.source, path.name, note=listed.note, when_s=when_s, picture=picture)
    recording = f"recordings/{quote(listed.recording)}" if listed.recording else ""
    row = replace(row, recording=recording, size=size(listed.size_bytes))
    if not path.is_dir():
        return replace(row, kind="recording")
    try:
        run = described(path, _changed_ns(path / RUN) or 0)
        row = replace(row, differs=table.differing_settings(run.methods, run.configs(), run.options))
        if run.forked:
            origin = run.forked[-1]
            row = replace(row, name=f"{path.name}: fork at frame {origin.get('at')}", parent=str(origin.get("run", "")))
        report = _json(path / METRICS)
        row = replace(row, errors=table.ates(report), located=table.located(report, run.exposures))
        row = replace(row, curves={error.method: curve for error in row.errors if (curve := _curve(path, run, error))})
        return replace(row, events=table.alarms(event.severity for event in read_events(path / EVENTS)))
    except InputError:
        return row


def _curve(path: Path, run: RunFile, error: table.Ate) -> tuple[float, ...]:
    """The position error of a method, against the truth as the run has it beside it; empty where that is not there."""
    estimate, truth = path / trajectory_file(error.method), path / TRUTH
    files = [_size(file) for file in (estimate, truth)]
    if not all(files) or sum(files) > MOST_BYTES or error.alignment not in get_args(Alignment):
        return ()
    kind: Alignment = error.alignment  # type: ignore[assignment]
    found = trajectory_error(read_tum(estimate, run.frame), read_tum(truth, run.frame), kind)
    return () if found is None else table.small_curve(found.position_errors_m)


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except OSError:
        return 0


def _group(path: Path, rows: list[Row]) -> Row | None:
    """None where none of its runs has ended."""
    members = [row for row in rows if row.parent == path.name]
    if not members:
        return None
    try:
        title = str(read_mapping(path / PLAN).get("title", ""))
    except InputError:
        title = ""
    kind, label = ("sweep", "Sweep") if path.name.startswith("sweep-") else ("experiment", "Experiment")
    newest = max((row.when_s for row in members if row.when_s is not None), default=None)
    return table.group(path.name, kind, f"{label}: {title[:120] or path.name}", members, newest)


def _json(path: Path) -> Mapping[str, Any]:
    """InputError where the file cannot be read or holds something else."""
    try:
        found = json.loads(read_bytes(path, MOST_BYTES))
    except (ValueError, RecursionError):
        raise InputError(f"{path} is not as `ispom run` writes it: run again") from None
    if not isinstance(found, dict):
        raise InputError(f"{path} is not as `ispom run` writes it: run again")
    return found


def _linked(folder: Path, name: str) -> bool:
    """Whether a part of the path is a link."""
    path = folder / name
    return any(part.is_symlink() for part in (path, *path.parents[: len(Path(name).parts) - 1]))


def _changed_ns(path: Path) -> int | None:
    try:
        return path.lstat().st_mtime_ns
    except OSError:
        return None
