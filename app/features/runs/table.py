"""The rows of the runs table, as values: what each run is, how accurate it was, and what happened in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import PurePosixPath
from typing import Any, Literal

import numpy as np

from ispom.geometry import Array
from ispom.methods import Config, in_order, method, names

from ...engine.options import SourceOptions
from ...engine.verdict import Severity
from ...presentation import colours
from ...presentation.texts import ALIGNED, length, length_unit
from ...session.branches.branches import changes

Kind = Literal["live", "run", "recording", "sweep", "experiment"]
LIVE = "live:"
"""Before the number of a branch as the key of its row; other keys are names in the recordings folder."""
MOST = 500
"""Rows that are sent to a page."""
CURVE_POINTS = 40


@dataclass(frozen=True)
class Ate:
    """Absolute trajectory error of one method."""

    method: str
    metres: float
    alignment: str


@dataclass(frozen=True)
class Row:
    key: str
    """The name in the recordings folder, or LIVE and the number of a branch."""
    kind: Kind
    source: str
    name: str
    parent: str = ""
    """The key of the run that it was forked from, or of the sweep that it belongs to."""
    differs: tuple[str, ...] = ()
    """Settings and options that are not the defaults; of a branch, that are not those of its parent."""
    errors: tuple[Ate, ...] = ()
    located: Mapping[str, float] | None = None
    """By method: the share of its frames at which it tracked, 0..1, of a group the least; None where it is unknown."""
    events: Mapping[Severity, int] | None = None
    """The number of events that need attention; None where that is unknown."""
    when_s: float | None = None
    """The time at which it was written [s since 1970]; None while it is computed."""
    note: str | None = None
    """A person's own; None where none can be kept."""
    picture: str = ""
    """Its address, relative to the page's; empty for none."""
    recording: str = ""
    """The address of its Rerun recording, relative to the page's; empty for none."""
    size: str = ""
    """On disk."""
    shown: bool = False
    """Whether the stage shows it."""
    curves: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """By method: its position error over the frames [m], as few points as a small picture has."""


def differing_settings(methods: Iterable[str], config: Config, options: Mapping[str, Any]) -> tuple[str, ...]:
    """The settings and source options that are not the defaults, as phrases; unknown options are ignored."""
    chosen = tuple(m for m in methods if m in names())
    usual = Config({name: method(name).config() for name in chosen})
    found = list(changes((chosen, usual), (chosen, config)))
    defaults = asdict(SourceOptions())
    others = {name: value for name, value in options.items() if name in defaults and value is not None}
    plain = {name: value for name, value in others.items() if str(value) != str(defaults[name])}
    return (*found, *(f"{name.replace('_', ' ')} {str(value)[:40]}" for name, value in plain.items()))


def ates(report: Mapping[str, Any]) -> tuple[Ate, ...]:
    """The errors that a metrics.json holds. Its values are not trusted."""
    found = []
    for name, entry in _entries(report).items():
        metres, alignment = entry.get("ate_m"), entry.get("aligned")
        if isinstance(metres, int | float) and not isinstance(metres, bool) and alignment in ALIGNED:
            found.append(Ate(name, float(metres), str(alignment)))
    return tuple(found)


def small_curve(metres: Array) -> tuple[float, ...]:
    """The largest value of each of CURVE_POINTS parts of a curve (N,), or all of fewer values."""
    if not len(metres):
        return ()
    starts = np.arange(0, len(metres), -(-len(metres) // CURVE_POINTS))
    return tuple(float(f"{value:.3g}") for value in np.maximum.reduceat(metres, starts).tolist())


def located(report: Mapping[str, Any], frames: Mapping[str, int]) -> dict[str, float]:
    """By method, the share of its frames at which it tracked, from a metrics.json; `frames` is the number of frames of
    each kind, for one that does not say how many the method saw."""
    found = {}
    for name, entry in _entries(report).items():
        own = entry.get("frames")  # the steps of the method, as a session counts them
        count = own if isinstance(own, int) and own > 0 else 0
        count = count or sum(n for kind, n in frames.items() if isinstance(n, int) and kind in method(name).sensors)
        if count and isinstance(known := entry.get("located"), int):
            found[name] = min(max(known / count, 0.0), 1.0)
    return found


def _entries(report: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    methods = report.get("methods")
    known = methods.items() if isinstance(methods, dict) else ()
    return {name: entry for name, entry in known if name in names() and isinstance(entry, dict)}


def alarms(severities: Iterable[Severity]) -> Counter[Severity]:
    """The number of events that need attention, by severity."""
    return Counter(severity for severity in severities if severity.alarming)


def group(key: str, kind: Kind, name: str, members: Sequence[Row], when_s: float | None) -> Row:
    """The row of a sweep or an experiment, over its runs."""
    sources = dict.fromkeys(row.source for row in members)
    shares: dict[str, float] = {}
    for row in members:
        for known, share in (row.located or {}).items():
            shares[known] = min(share, shares.get(known, 1.0))
    events = sum((Counter(row.events or {}) for row in members), Counter[Severity]())
    picture = next((row.picture for row in members if row.picture), "")
    errors = tuple(error for row in members for error in row.errors)
    count = f"{len(members)} run{'' if len(members) == 1 else 's'}"
    return Row(key, kind, ", ".join(sources), name, "", (count,), errors, shares, events, when_s, picture=picture)


def arranged(rows: Iterable[Row]) -> list[tuple[Row, int]]:
    """Every row with its depth: newest first, each followed by its forks and members. A parent that is not there, or a
    circle of parents, makes a row of its own."""
    known = {row.key: row for row in rows}
    children: dict[str, list[Row]] = {}
    for row in known.values():
        children.setdefault(row.parent if _rooted(row, known) else "", []).append(row)
    found: list[tuple[Row, int]] = []
    waiting = [(row, 0) for row in reversed(_sorted(children.get("", [])))]
    while waiting:
        row, depth = waiting.pop()
        found.append((row, depth))
        waiting += [(child, depth + 1) for child in reversed(_sorted(children.get(row.key, [])))]
    return found


def _rooted(row: Row, known: Mapping[str, Row]) -> bool:
    """Whether its parent is there, and following parents comes to an end."""
    seen, at = set[str](), row.key
    while at in known and known[at].parent:
        if at in seen:
            return False
        seen.add(at)
        at = known[at].parent
    return row.parent in known


def _sorted(rows: Iterable[Row]) -> list[Row]:
    """Live ones first in the order in which they began, then the newest first."""
    return sorted(rows, key=lambda row: -row.when_s if row.when_s is not None else float("-inf"))


def table_message(rows: Sequence[Row]) -> dict[str, Any]:
    """What the page shows: the columns of errors, and the rows from top to bottom."""
    placed = arranged(rows)
    families = dict.fromkeys(name.partition(".")[0] for name in in_order({e.method for r in rows for e in r.errors}))
    columns = []
    for family in families:
        used = {e.alignment for row in rows for e in row.errors if e.method.partition(".")[0] == family}
        only = ALIGNED[used.pop()] if len(used) == 1 else ""
        columns.append({"family": family, "label": colours.label(family), "alignment": only})
    best = _best(rows)
    entries = [_message(row, depth, columns, best) for row, depth in placed[:MOST]]
    return {"columns": columns, "rows": entries, "omitted": max(len(placed) - MOST, 0)}


Alike = tuple[str, str, str]
"""Source, method and alignment: errors that can be compared."""


def _best(rows: Iterable[Row]) -> dict[Alike, float]:
    """The smallest error of those of several runs that can be compared [m]."""
    found: dict[Alike, list[float]] = {}
    for row in rows:
        for error in row.errors if row.kind in ("live", "run") else ():
            found.setdefault((row.source, error.method, error.alignment), []).append(error.metres)
    return {alike: min(metres) for alike, metres in found.items() if len(metres) > 1}


def _message(row: Row, depth: int, columns: Sequence[Mapping[str, str]], best: Mapping[Alike, float]) -> dict[str, Any]:
    shares, events = row.located, row.events
    return {
        "key": row.key,
        "kind": row.kind,
        "parent": row.parent,
        "depth": depth,
        "source": row.source,
        "name": row.name,
        "differs": row.differs,
        "ate": [_cells(row, column["family"], bool(column["alignment"]), best) for column in columns],
        "curves": [
            {"label": colours.label(name), "colour": colours.css(colours.of(name)), "values": row.curves[name]}
            for name in in_order(row.curves)
            if row.curves[name]
        ],
        "located": [[colours.label(name), round(shares[name], 4)] for name in in_order(shares)] if shares else [],
        "events": None if events is None else sum(events.values()),
        "worst": str(max(events, key=list(Severity).index)) if events else "",
        "events_by": {str(severity): count for severity, count in (events or {}).items()},
        "when": row.when_s,
        "note": row.note,
        "picture": row.picture,
        "recording": row.recording,
        "size": row.size,
        "shown": row.shown,
    }


def _cells(row: Row, family: str, aligned_alike: bool, best: Mapping[Alike, float]) -> list[dict[str, Any]]:
    """The errors of the methods of a family in a row; of a group, from the least to the largest."""
    found = []
    for name in in_order({e.method for e in row.errors if e.method.partition(".")[0] == family}):
        errors = [e for e in row.errors if e.method == name]
        metres = sorted(e.metres for e in errors)
        unit = length_unit(metres)
        text = length(metres[-1], unit)
        if len(metres) > 1:
            text = f"{length(metres[0], unit).removesuffix(f' {unit.name}')} – {text}"
        alignments = dict.fromkeys(ALIGNED[e.alignment] for e in errors)
        alignment = "" if aligned_alike else ", ".join(alignments)
        is_best = any(e.metres <= best.get((row.source, name, e.alignment), -1.0) for e in errors)
        found.append(
            {
                "variant": colours.variant(name),
                "text": text,
                "alignment": alignment,
                "best": is_best and len(errors) == 1,
            }
        )
    return found


def forked_parent(run: str, keys: Iterable[str]) -> str:
    """The key of the run that a run.yaml names as its origin; empty where it is not in the table."""
    name = PurePosixPath(run.replace("\\", "/")).name
    return next((key for key in keys if name and PurePosixPath(key).name == name), "")


def under_groups(rows: Iterable[Row], groups: Iterable[str]) -> list[Row]:
    """The rows, those inside a sweep's or an experiment's folder as its members."""
    folders = tuple(groups)
    found = []
    for row in rows:
        of = next((folder for folder in folders if row.key.startswith(f"{folder}/")), "")
        found.append(replace(row, parent=of, name=row.key.removeprefix(f"{of}/runs/")) if of else row)
    return found
