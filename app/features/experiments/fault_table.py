"""The table of `ispom experiment faults`, as Markdown: what is published is written by this, never by hand."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.rows import read_text
from ispom.simulation.scenario.kinds import HEALTHY

BEGIN, END = "<!-- ispom experiment faults: begin -->", "<!-- ispom experiment faults: end -->"
NOTHING = "no cause"
WITHIN_SIGMAS = 2.0
Row = dict[str, Any]


def markdown(rows: Sequence[Row], rules: str) -> str:
    """Returns the parts that there are rows for: healthy stretches, faults on simulations and recordings, methods."""
    rows = _without_folder(_once(rows))
    parts = [f"Rules of the doctor: `{rules}`."]
    if healthy := [row for row in rows if _parts(row)[1] == HEALTHY]:
        parts.append(_healthy(healthy))
    for title, simulated in (("Faults on simulations", True), ("Faults on recordings", False)):
        if faulty := [row for row in rows if _parts(row)[1] != HEALTHY and row["simulated"] == simulated]:
            parts.append(f"## {title}\n\n{_sources(faulty)}\n\n{_faults(faulty)}")
    if played := [row for row in rows if row["methods"]]:
        parts.append(f"## Methods\n\n{_methods(played)}")
    return "\n\n".join(parts) + "\n"


def _once(rows: Sequence[Row]) -> list[Row]:
    """Returns the rows without those of a stretch that was asked for in two ways, such as 0-44 and 1/3."""
    return list({(r["source"], r["seed"], r["first"], r["last"], r["kind"]): r for r in rows}.values())


def _without_folder(rows: Sequence[Row]) -> list[Row]:
    """Returns the rows with recordings named below the folder that all of them are in."""
    of_rows = {row["source"] for row in rows if not row["simulated"]}
    folder = os.path.commonpath([os.path.dirname(source) for source in of_rows]) if of_rows else ""
    short = {source: os.path.relpath(source, folder or ".") for source in of_rows}
    return [{**row, "source": short.get(row["source"], row["source"])} for row in rows]


def merged(file: Path, text: str) -> str:
    """Returns the content of a Markdown file with the text between its two marks. Raises InputError without them."""
    content = read_text(file) if exists(file) else f"{BEGIN}\n{END}\n"
    before, begin, rest = content.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"{file} has no place for the table: write the lines '{BEGIN}' and '{END}' where it belongs")
    return f"{before}{BEGIN}\n\n{text}\n{END}{after}"


def _healthy(rows: Sequence[Row]) -> str:
    tested = [row for row in rows if row["failure"] is None]
    alarms = [row for row in tested if row["causes"]]
    lines = []
    for source in _in_order(row["source"] for row in rows):
        own = [row for row in rows if row["source"] == source]
        for said in _in_order(map(_said, own)):
            same = [row for row in own if _said(row) == said]
            lines.append((source, ", ".join(map(_place, same)), str(len(same)), said))
    head = f"## Stretches without a fault\n\nOf {len(tested)} stretches, a cause was named in {len(alarms)}."
    return f"{head}\n\n{_table(('recording', 'frames', 'stretches', 'what came first'), lines)}"


def _place(row: Row) -> str:
    about = [f"seed {row['seed']}"] if row["simulated"] else []
    about += [f"after {before}"] if (before := _parts(row)[0]) else []
    frames = f"{row['first']}-{row['last']}"
    return f"{frames} ({', '.join(about)})" if about else frames


def _said(row: Row) -> str:
    """What came first."""
    if row["failure"] is not None:
        return f"failed: {row['failure']}"
    return row["causes"][0] if row["causes"] else NOTHING


def _sources(rows: Sequence[Row]) -> str:
    """Says what the faults were put onto."""
    seeds = sorted({row["seed"] for row in rows})
    of_seeds = f"; seeds {', '.join(map(str, seeds))}" if rows[0]["simulated"] else ""
    named = [f"`{row['source']}`{f' (after `{before}`)' if (before := _parts(row)[0]) else ''}" for row in rows]
    return f"On {', '.join(_in_order(named))}{of_seeds}."


def _parts(row: Row) -> tuple[str, str]:
    """What was put on first, and the kind itself."""
    before, _, kind = row["kind"].rpartition("+")
    return before, kind


def _faults(rows: Sequence[Row]) -> str:
    """A row for each kind: how often the right suspect was first, and its figures right.

    Kinds of which the doctor knows no cause do not count in the last row.
    """
    lines, total, known = [], Counter[str](), 0
    for kind in _in_order(_parts(row)[1] for row in rows):
        own = [row for row in rows if _parts(row)[1] == kind]
        counts, answers = _counts(own), Counter(map(_said, own))
        said = ", ".join(f"{answer} {count}" for answer, count in answers.most_common())
        if not own[0]["right"]:
            lines.append((kind, "none is known", str(len(own)), f"{answers[NOTHING]} named nothing", "", "", "", said))
            continue
        total.update(counts)
        known += 1
        right = " or ".join(own[0]["right"])
        lines.append(
            (kind, right, *(str(counts[key]) for key in ("cases", "first", "third", "silent")), _ratio(counts), said)
        )
    cases = max(1, total["cases"])
    first, third = (f"{100 * total[key] / cases:.0f} %" for key in ("first", "third"))
    ends = (str(total["cases"]), first, third, str(total["silent"]), _ratio(total), "")
    lines.append((f"all {known} kinds", "", *ends))
    head = ("fault", "right", "cases", "first", "in the first three", "cannot tell", "figure within 2 sigma")
    head = (*head, "what came first")
    return _table(head, lines)


def _counts(rows: Sequence[Row]) -> Counter[str]:
    found = Counter[str]()
    for row in rows:
        places = [row["causes"].index(key) for key in row["right"] if key in row["causes"]]
        stated = [f for f in row["figures"].values() if f["sigma"] is not None and f["right"]]
        found.update({
            "cases": 1,
            "first": int(bool(places) and min(places) == 0),
            "third": int(bool(places) and min(places) < 3),
            "silent": int(not row["causes"] and all(key in row["silent"] for key in row["right"])),
            "stated": int(bool(stated)),
            "within": int(bool(stated) and all(within(f) for f in stated)),
        })  # fmt: skip
    return found


def within(figure: dict[str, float]) -> bool:
    """Checks that what is right lies within 2 sigma of what is said."""
    return abs(figure["said"] - figure["right"]) <= WITHIN_SIGMAS * figure["sigma"]


def _ratio(counts: Counter[str]) -> str:
    return f"{counts['within']} of {counts['stated']}" if counts["stated"] else ""


def _methods(rows: Sequence[Row]) -> str:
    """Of each fault and method: located frames, and the median error."""
    names = _in_order(name for row in rows for name in row["methods"])
    lines = []
    for kind in _in_order(row["kind"] for row in rows):
        own = [row["methods"] for row in rows if row["kind"] == kind]
        lines.append((kind, str(len(own)), *(_method([each[name] for each in own if name in each]) for name in names)))
    head = ("fault", "cases", *(f"{name}: located, ATE" for name in names))
    return f"Located frames, and the median error of the cases that have one.\n\n{_table(head, lines)}"


def _method(results: Sequence[Row]) -> str:
    frames, located = (sum(each[key] for each in results) for key in ("frames", "located"))
    if not frames:
        return "–"
    errors = [each["ate_m"] for each in results if each["ate_m"] is not None]
    error = f", {1000 * median(errors):.3g} mm" if errors else ""
    return f"{100 * located / frames:.0f} %{error}"


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    cells = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in cells)


def _in_order(values: Iterable[str]) -> list[str]:
    """Returns each value once, in the order of its first place."""
    return list(dict.fromkeys(values))
