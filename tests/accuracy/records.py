"""Records of the benchmark: one JSON file for each release, and the page that shows them one beside another.

A record is written once and never changed. It is read strictly: a key that is missing, unknown or of another type is an
error.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec
from ispom_app.engine.outputs import json_text
from packaging.version import InvalidVersion, Version

PAGE = Path(__file__).parents[2] / "docs" / "evaluation" / "benchmark.md"
STUDY = "benchmark"
FOLDER = "records"
"""Beside the page."""


class Machine(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where a record was measured."""

    processor: str
    cores: int
    """Logical ones."""
    memory_gb: float
    system: str
    python: str
    packages: dict[str, str]
    """Versions of those that compute."""
    unit_ms: float
    """The unit U of `tests.accuracy.unit` [CPU ms], by which times of machines are compared."""
    unit_pair: str
    """The images on which U was measured."""
    load: float | None
    """Mean number of processes that wanted a core meanwhile, of this benchmark and of others; None where unknown."""


class Row(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """One method on one recording. A run that failed has a reason, and no figures."""

    recording: str
    method: str
    failed: str | None = None
    """What it said; None for a run that came to its end."""
    refused: str | None = None
    """The check that failed last, where no frame was localised; None otherwise."""
    frames: int = 0
    """Frames that the method uses."""
    located: int = 0
    """Frames that were localised when they came."""
    lost: int = 0
    """Frames at which it was lost, after it had a map."""
    segments: int = 0
    """Parts of the trajectory that no observation joins."""
    ms: float | None = None
    """CPU time for a frame [ms], the median; reading and decoding included."""
    cpu_s: float = 0.0
    """CPU time of the run [s]."""
    alignment: str | None = None
    """se3 or sim3; None without reference, as all that follows."""
    path: float | None = None
    """Length of the reference, in its unit (metres where there is ground truth)."""
    ate: float | None = None
    """Of all poses, held ones too, in the same unit; None where nothing was localised."""
    segment_ate: float | None = None
    """Where each segment is aligned alone; None for one segment."""
    rpe_over: str | None = None
    """Path length of the motions that are compared, in the reference's unit; a time such as "0.5 s" where the
    rig stands still."""
    rpe: float | None = None
    """Root mean square error of these motions: in percent of their length; over a time, in the reference's unit."""
    rpe_deg: float | None = None
    """That of their rotations [deg]."""


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What one release reaches."""

    version: str
    date: str
    """Of the measurement: year, month and day in UTC."""
    commit: str
    """Git's name of the code; with " and changes" where files were changed and not committed."""
    command: str
    machine: Machine
    left_out: list[str]
    """Recordings with held figures that were not measured."""
    rows: list[Row]


def read_records(folder: Path) -> list[Record]:
    """Returns all records, the oldest version first. Raises ValueError naming the file that is none."""
    records = []
    for path in folder.glob("*.json"):
        try:
            record = msgspec.json.decode(path.read_bytes(), type=Record)
        except msgspec.DecodeError as error:
            raise ValueError(f"{path}: {error}") from None
        if record.version != path.stem:
            raise ValueError(f"{path}: it is the record of {record.version}")
        records.append(record)
    return sorted(records, key=lambda record: Version(record.version))


def append_record(record: Record, folder: Path) -> Path:
    """Writes the record of a new release. Raises FileExistsError where that release has one, ValueError for a name that
    is no version."""
    path = record_path(record.version, folder)
    folder.mkdir(parents=True, exist_ok=True)
    with path.open("x", encoding="utf-8") as file:
        file.write(record_text(record))
    return path


def record_path(version: str, folder: Path) -> Path:
    """Returns where the record of a version is. Raises ValueError for a name that is no version."""
    try:
        Version(version)
    except InvalidVersion:
        raise ValueError(f"'{version}' is no version: give one like 0.2.0") from None
    return folder / f"{version}.json"


def record_text(record: Record) -> str:
    """Returns the content of the file: a line for each row, so that it can be reviewed."""
    parts = msgspec.to_builtins(record)
    rows = parts.pop("rows")
    head = json_text(parts, 2).rstrip().removesuffix("}").rstrip()
    lines = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in rows)
    return f'{head},\n  "rows": [\n{lines}\n  ]\n}}\n'


def markdown(records: Sequence[Record]) -> str:
    """Returns what stands between the marks of the page."""
    if not records:
        return "No release has a record yet."
    parts = ["## Releases and machines", _machines(records), *map(_left_out, records)]
    parts += ["## Failures", *map(_failures, records)]
    for recording in dict.fromkeys(row.recording for record in records for row in record.rows):
        parts += [f"## {recording}", *_recording(recording, records)]
    return "\n\n".join(part for part in parts if part)


def _machines(records: Sequence[Record]) -> str:
    rows = [
        ("measured on", [r.date for r in records]),
        ("commit", [f"`{r.commit[:10]}`{r.commit[40:]}" for r in records]),
        ("command", [f"`{r.command}`" for r in records]),
        ("processor", [r.machine.processor for r in records]),
        ("logical cores", [str(r.machine.cores) for r in records]),
        ("memory", [f"{r.machine.memory_gb:g} GB" for r in records]),
        ("system", [r.machine.system for r in records]),
        ("Python", [r.machine.python for r in records]),
        *((name, [r.machine.packages.get(name, "") for r in records]) for name in _packages(records)),
        ("unit U", [f"{r.machine.unit_ms:g} ms, on {r.machine.unit_pair}" for r in records]),
        ("load", ["unknown" if r.machine.load is None else f"{r.machine.load:g} processes" for r in records]),
        ("runs", [str(len(r.rows)) for r in records]),
    ]
    return _table(("", *(r.version for r in records)), ((name, *cells) for name, cells in rows))


def _packages(records: Sequence[Record]) -> list[str]:
    return sorted({name for record in records for name in record.machine.packages})


def _left_out(record: Record) -> str:
    if not record.left_out:
        return ""
    return f"Not measured for {record.version}: {', '.join(f'`{name}`' for name in record.left_out)}."


def _failures(record: Record) -> str:
    rows = record.rows
    failed, refused = (sum(getattr(row, name) is not None for row in rows) for name in ("failed", "refused"))
    lost = sum(row.refused is None and row.lost > 0 for row in rows)
    split = sum(row.segments > 1 for row in rows)
    return (
        f"{record.version}, of {len(rows)} runs: {failed} ended with an error, {refused} localised no frame, {lost} "
        f"were lost at some frames, and {split} have a path in several segments."
    )


def _recording(name: str, records: Sequence[Record]) -> list[str]:
    """The heading's first sentence, and the table of a recording: the releases of a method follow each other."""
    rows = [(record.version, row) for record in records for row in record.rows if row.recording == name]
    methods = list(dict.fromkeys(row.method for _, row in rows))
    rows.sort(key=lambda each: methods.index(each[1].method))
    about = dict.fromkeys(_about(row) for _, row in rows if row.failed is None)
    head = ("method", "release", "located", "lost", "segments", "ATE", "per segment", "RPE", "RPE deg", "ms", "failure")
    return [*about, _table(head, ((f"`{row.method}`", version, *_cells(row)) for version, row in rows))]


def _about(row: Row) -> str:
    if row.path is None:
        return "No reference."
    over = f"; RPE over {row.rpe_over}" if row.rpe_over else ""
    return f"The reference is {row.path:g} long{over}."


def _cells(row: Row) -> Iterable[str]:
    if row.failed is not None:
        return *("",) * 8, f"**failed**: {_escaped(row.failed)}"
    located = f"{row.located} of {row.frames}" if row.located else f"**none** of {row.frames}"
    failure = "" if row.refused is None else f"refused: {_escaped(row.refused)}"
    errors = (_short(value) for value in (row.ate, row.segment_ate, row.rpe, row.rpe_deg, row.ms))
    return located, str(row.lost), str(row.segments), *errors, failure


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _escaped(text: str) -> str:
    """Returns words of the program as Markdown: on one line, and without markup."""
    return re.sub(r"([*_|<\[\]{}$\\`])", r"\\\1", " ".join(text.split()))


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = tuple(head)
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
