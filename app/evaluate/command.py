"""`ispom evaluate`: estimates beside a reference, in numbers that come with their protocol."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table

from ispom.errors import InputError
from ispom.evaluation.association import associate
from ispom.evaluation.ate import Alignment
from ispom.evaluation.comparison import MIN_POSES, Comparison, compare, local_scale, measures
from ispom.io.kitti import read_times
from ispom.io.trajectories import TrajectoryFile, read_trajectory
from ispom.io.whole import write_whole

from ..options import Evaluate

ALIGNMENTS = {
    "none": "none: coordinates are compared as they are",
    "first": "first: the first compared poses coincide",
    "scale": "scale: only the unit is fitted, over all compared poses",
    "se3": "se3: rotation and translation, no scale, fitted over all compared poses",
    "sim3": "sim3: rotation, translation and scale, fitted over all compared poses",
}
ROWS = {
    "poses_given": ("poses compared", "d"),
    "poses_asked": ("  of asked", "d"),
    "longest_gap_s": ("longest gap [s]", ".2f"),
    "alignment_scale": ("scale of the alignment", ".4f"),
    "ate_rmse_m": ("ATE, RMS [m]", ".4f"),
    "ate_median_m": ("  median [m]", ".4f"),
    "ate_max_m": ("  largest [m]", ".4f"),
    "ate_rmse_deg": ("  rotation, RMS [deg]", ".4f"),
    "rpe_rmse_m": ("RPE, RMS [m]", ".4f"),
    "rpe_rmse_deg": ("  rotation, RMS [deg]", ".4f"),
    "kitti_t_percent": ("KITTI t_err [%]", ".3f"),
    "kitti_r_deg_per_100m": ("KITTI r_err [deg/100 m]", ".3f"),
    "kitti_shortest_m": ("  over lengths from [m]", "d"),
    "kitti_longest_m": ("  to [m]", "d"),
    "scale_start": ("local scale at the start", ".4f"),
    "scale_end": ("  at the end", ".4f"),
    "scale_end_over_start": ("  end / start", ".4f"),
}


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One estimate, by the name that tells it from the others."""

    name: str
    file: TrajectoryFile
    found: Comparison

    @property
    def measures(self) -> dict[str, float | None]:
        """Without a gap in seconds where only rows are known."""
        values = measures(self.found)
        return values if self.file.timed else values | {"longest_gap_s": None}

    def notes(self, kind: Alignment) -> list[str]:
        """What keeps the numbers from meaning what they seem to."""
        if kind in ("se3", "sim3") and self.found.straight:
            return [
                f"{self.name}: the compared path is nearly straight: the alignment hardly fixes the turn about it, "
                "on which the rotation of ATE depends; --alignment first fixes it by the first pose"
            ]
        return []


def evaluate(options: Evaluate) -> int:
    """Compares, prints and writes what is asked; InputError where that cannot be."""
    if not options.estimates:
        raise InputError("no estimate was given: name at least one trajectory file after the reference")
    if options.delta < 1 or not 0 <= options.max_difference_s < math.inf:
        raise InputError("--delta must be at least 1 and --max-difference-s not negative: give other values")
    times_ns = read_times(options.times) if options.times else None
    reference = read_trajectory(options.reference, times_ns)
    files = [read_trajectory(path, times_ns) for path in options.estimates]
    names = distinct_names([file.path for file in files])
    items = [Evaluated(n, f, _compare(f, reference, options)) for n, f in zip(names, files, strict=True)]
    protocol = _protocol(reference, files, options)
    notes = [note for item in items for note in item.notes(options.alignment)]
    _print(protocol, items, notes)
    if options.json is not None:
        write_whole(options.json, _json_text(reference, protocol, items, notes))
    if options.csv is not None:
        write_whole(options.csv, _csv_text(protocol, items))
    if options.plots is not None:
        from .plots import write_plots  # brings matplotlib

        write_plots(options.plots, options.plot_format, items, f"alignment {options.alignment}", reference.timed)
    return 0


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """The file names, with as many of their folders as it takes to tell all apart."""
    for depth in range(1, max(len(p.parts) for p in paths) + 1):
        names = ["/".join(p.parts[-depth:]) for p in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{i}: {p}" for i, p in enumerate(paths, 1)]


def _compare(file: TrajectoryFile, reference: TrajectoryFile, options: Evaluate) -> Comparison:
    own, other = file.trajectory, reference.trajectory
    if file.timed != reference.timed:
        raise InputError(
            f"of {file.path} and {reference.path} only one has times: give those of the KITTI file's rows by --times"
        )
    if file.timed:
        pairs = associate(own, other, round(options.max_difference_s * 1e9))
    elif len(own) == len(other):
        pairs = own, other
    else:
        raise InputError(
            f"{file.path} has {len(own)} rows, {reference.path} {len(other)}, and KITTI files are compared row by row: "
            "give files of the same length, or TUM files"
        )
    if len(pairs[0]) < MIN_POSES:
        raise InputError(
            f"{file.path} has {len(pairs[0])} poses within {options.max_difference_s:g} s of one of {reference.path}, "
            f"fewer than {MIN_POSES}: give files of the same recording, or a larger --max-difference-s"
        )
    return compare(own, other, pairs, options.alignment, options.delta)


def _frame(file: TrajectoryFile) -> str | None:
    """Whose poses a file holds, where that is known: EuRoC's truth is of the body; `ispom run` says it beside."""
    if file.format == "EuRoC":
        return "body"
    try:
        told = yaml.safe_load((file.path.parent / "run.yaml").read_text(encoding="utf-8"))
        return str(told["options"]["frame"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError, yaml.YAMLError):
        return None


def _protocol(reference: TrajectoryFile, files: list[TrajectoryFile], options: Evaluate) -> dict[str, str]:
    """What must be known to read the numbers rightly."""
    frames = {str(file.path): _frame(file) for file in (reference, *files)}
    known = {frame for frame in frames.values() if frame}
    frame = ", ".join(f"{path}: {frame or 'not told by the file'}" for path, frame in frames.items())
    warning = " (different frames: the lever arm between them counts as error)" if len(known) > 1 else ""
    row = "row by row: these KITTI files have no times"
    time = f"each pose of the shorter file with the nearest in time, at most {options.max_difference_s:g} s away"
    poses, path_m = len(reference.trajectory), reference.trajectory.length
    seconds = (reference.trajectory.times_ns[-1] - reference.trajectory.times_ns[0]) * 1e-9
    span = f" over {seconds:.1f} s" if reference.timed else ""
    return {
        "reference": f"{reference.path} ({reference.format}, {poses} poses, {path_m:.1f} m{span})",
        "estimates": ", ".join(f"{f.path} ({f.format}, {len(f.trajectory)} poses)" for f in files),
        "frames": f"poses are compared as the files have them{warning}; {frame}",
        "association": time if reference.timed else row,
        "alignment": ALIGNMENTS[options.alignment],
        "RPE": f"over all pairs of compared poses i, i + {options.delta}",
        "KITTI": "mean over 100 to 800 m from every tenth pose; below 200 m over 5 to 40 m from every pose",
        "local scale": "path in the estimate, before alignment, over path in the reference, in ten windows along it",
    }


def _print(protocol: dict[str, str], items: list[Evaluated], notes: list[str]) -> None:
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for name, text in protocol.items():
        console.print(f"{name}: {text}")
    table = Table("", *(item.name for item in items), pad_edge=False)
    for column in table.columns[1:]:
        column.justify, column.overflow = "right", "fold"
    columns = [item.measures for item in items]
    for key, (title, form) in ROWS.items():
        values = [column[key] for column in columns]
        table.add_row(title, *("-" if value is None else format(value, form) for value in values))
    console.print(table)
    for note in notes:
        console.print(note)


def _json_text(reference: TrajectoryFile, protocol: dict[str, str], items: list[Evaluated], notes: list[str]) -> str:
    report = {
        "protocol": protocol,
        "notes": notes,
        "reference": _about(reference),
        "estimates": [
            {"name": item.name, **_about(item.file), **item.measures, "local_scale": local_scale(item.found)}
            for item in items
        ],
    }
    return json.dumps(report, indent=2, allow_nan=False) + "\n"


def _about(file: TrajectoryFile) -> dict[str, Any]:
    return {
        "path": str(file.path),
        "format": file.format,
        "poses": len(file.trajectory),
        "frame": _frame(file),
        "timed": file.timed,
    }


def _csv_text(protocol: dict[str, str], items: list[Evaluated]) -> str:
    """One line per estimate; the protocol is the same in all of them."""
    out = io.StringIO()
    told = {key: protocol[key] for key in ("reference", "frames", "association", "alignment", "RPE")}
    rows = [{"estimate": item.name, **item.measures, **told} for item in items]
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()
