"""An evaluation as a table on the terminal, as CSV, and for LaTeX."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console
from rich.table import Table

from ispom.errors import printable

from ...engine.outputs import csv_of
from ...presentation.texts import length_unit
from .evaluated import Evaluated

JSON_HEAD, CSV_HEAD, LATEX_HEAD = '"protocol": {', "estimate,", "% ispom evaluate"
"""How the files begin: by this they are known as ours."""
LENGTH = "length"
"""A row of lengths, in a unit that it shares with the others of the same error."""
ROWS = {
    "poses_given": ("poses compared", "d"),
    "poses_asked": ("  of asked", "d"),
    "longest_gap_s": ("longest gap [s]", ".2f"),
    "alignment_scale": ("scale of the alignment", ".4f"),
    "ate_rmse_m": ("ATE, RMS", LENGTH),
    "ate_median_m": ("  median", LENGTH),
    "ate_max_m": ("  largest", LENGTH),
    "ate_rmse_deg": ("  rotation, RMS [deg]", ".4f"),
    "rpe_rmse_m": ("RPE, RMS", LENGTH),
    "rpe_rmse_deg": ("  rotation, RMS [deg]", ".4f"),
    "kitti_t_percent": ("KITTI t_err [%]", ".3f"),
    "kitti_r_deg_per_100m": ("KITTI r_err [deg/100 m]", ".3f"),
    "kitti_shortest_m": ("  over lengths from [m]", "d"),
    "kitti_longest_m": ("  to [m]", "d"),
    "scale_start": ("local scale at the start", ".4f"),
    "scale_end": ("  at the end", ".4f"),
    "scale_end_over_start": ("  end / start", ".4f"),
}


def print_table(protocol: dict[str, str], items: list[Evaluated], notes: list[str]) -> None:
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for name, text in protocol.items():
        console.print(_plain(f"{name}: {text}"))
    table = Table("", *(_plain(item.name) for item in items), pad_edge=False)
    for column in table.columns[1:]:
        column.justify, column.overflow = "right", "fold"
    columns = [item.measures for item in items]
    shares = [share_percent(column) for column in columns]
    for key, title, form, rows in _rows(items):
        values = [column[key] if i in rows else None for i, column in enumerate(columns)]
        if form == LENGTH:
            error = key.partition("_")[0]
            unit = length_unit(c[k] for c in columns for k in ROWS if k.startswith(error) and ROWS[k][1] == LENGTH)
            table.add_row(f"{title} [{unit.name}]", *("-" if v is None else unit.of(v) for v in values))
        else:
            table.add_row(title, *("-" if value is None else format(value, form) for value in values))
        if key.endswith("_rmse_m"):  # an error is of those poses only
            table.add_row(
                "  of poses [%]", *("-" if v is None else f"{s:.0f}" for v, s in zip(values, shares, strict=True))
            )
    console.print(table)
    for note in notes:
        console.print(_plain(note))


def share_percent(measures: Mapping[str, float | None]) -> float:
    """Returns the share of the asked poses of which the errors are [%]."""
    return 100 * (measures["poses_given"] or 0) / max(measures["poses_asked"] or 0, 1)


SAME_INTERVAL = 1.5
"""Largest ratio of the times of motions whose errors stand in one row: those of a keyframe trajectory are of longer
motions, and larger for that reason alone."""


def _rows(items: list[Evaluated]) -> list[tuple[str, str, str, tuple[int, ...]]]:
    """Returns key, title and form of each row, and the numbers of the estimates that it holds."""
    everyone, groups = tuple(range(len(items))), rpe_groups(items)
    found = []
    for key, (title, form) in ROWS.items():
        if not key.startswith("rpe_"):
            found.append((key, title, form, everyone))
    place = next(i for i, row in enumerate(found) if row[0] == "kitti_t_percent")
    rpe = []
    for group in groups:
        interval = items[group[0]].rpe_interval_s
        words = "" if len(groups) == 1 or interval is None else f" over {interval:.3g} s"
        for key, (title, form) in ROWS.items():
            if key.startswith("rpe_"):
                rpe.append((key, title.replace("RPE", f"RPE{words}"), form, group))
    return [*found[:place], *rpe, *found[place:]]


def rpe_groups(items: list[Evaluated]) -> list[tuple[int, ...]]:
    """Returns the numbers of the estimates whose relative errors are of motions of about the same time."""
    if not items or items[0].found.delta.unit != "poses":
        return [tuple(range(len(items)))]
    times = [item.rpe_interval_s for item in items]
    groups: list[list[int]] = []
    for i, time in enumerate(times):
        for group in groups:
            other = times[group[0]]
            if time is None or other is None or 1 / SAME_INTERVAL <= time / max(other, 1e-12) <= SAME_INTERVAL:
                group.append(i)
                break
        else:
            groups.append([i])
    return [tuple(group) for group in groups]


def _plain(text: str) -> str:
    """Without control characters, however long."""
    return "".join(map(printable, text))


def csv_text(protocol: dict[str, str], items: list[Evaluated]) -> str:
    """One line per estimate; the protocol is the same in all of them."""
    stated = {key: protocol[key] for key in ("reference", "frames", "association", "alignment", "RPE")}
    rows = [{"estimate": item.name, **item.measures, **stated} for item in items]
    return csv_of(list(rows[0]), (list(row.values()) for row in rows))


LATEX_COLUMNS = (
    ("ate_rmse_m", "ATE"),
    ("ate_rmse_deg", "rotation [deg]"),
    ("rpe_rmse_m", "RPE"),
    ("rpe_rmse_deg", "rotation [deg]"),
)
"""Errors in the table for LaTeX, and their titles; lengths have their unit in the title."""
ESCAPED = str.maketrans({c: f"\\{c}" for c in "&%$#_{}"} | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}"})


def latex_text(protocol: dict[str, str], items: list[Evaluated]) -> str:
    """A table with booktabs: one row per estimate, its coverage first, and the protocol as a comment."""
    columns = [item.measures for item in items]
    units = {key: length_unit(c[key] for c in columns) for key, _ in LATEX_COLUMNS if key.endswith("_m")}
    titles = [f"{title} [{units[key].name}]" if key in units else title for key, title in LATEX_COLUMNS]
    rows = []
    for item, values in zip(items, columns, strict=True):
        cells = [_plain(item.name).translate(ESCAPED), f"{share_percent(values):.0f}"]
        for key, _ in LATEX_COLUMNS:
            value = values[key]
            cells.append("--" if value is None else units[key].of(value) if key in units else f"{value:.3f}")
        rows.append(" & ".join(cells) + r" \\")
    head = " & ".join(["", r"poses [\%]", *titles]) + r" \\"
    comments = [f"% {name}: {_plain(text)}" for name, text in protocol.items()]
    begin, end = rf"\begin{{tabular}}{{l{'r' * (1 + len(titles))}}}", r"\end{tabular}"
    lines = [LATEX_HEAD, *comments, begin, r"\toprule", head, r"\midrule", *rows, r"\bottomrule", end]
    return "\n".join(lines) + "\n"
