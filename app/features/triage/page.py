"""What is written in the end: the page, the tables, and the note on how to film."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from ispom.errors import counted
from ispom.io.whole import write_whole

from ...engine.outputs import csv_of, json_of
from ...presentation import colours
from ...presentation.templating import environment
from ..report.html import PACKAGE as REPORT
from ..report.html import POLICY, own_text
from .advice import Lesson, how_to_film
from .clips import Clip
from .row import Action, ClipRow, Group, Row
from .written import ALL, TriageFile

PAGE, TABLE, NOTE = "index.html", "triage.csv", "how_to_film.md"
PACKAGE = __name__.rpartition(".")[0]
GENERATOR = "ISPOM triage"
TROUBLE = {Group.LOST: "lost at", Group.NO_MAP: "still no map at"}
"""What is said before the frames at which it went wrong."""
TITLES = {
    Group.UNOPENED: "Cannot be opened",
    Group.NO_MAP: "No map",
    Group.LOST: "Lost",
    Group.SUSPICIOUS: "Suspicious",
    Group.FINE: "Fine",
}


def write_output(out: Path, folder: Path, clips: Sequence[Clip], rows: Sequence[Row]) -> None:
    """Writes triage.csv, triage.json, how_to_film.md and index.html; `rows` are those of `clips`, in their order."""
    lessons = how_to_film(rows)
    tabled = [ClipRow(*(getattr(row, name) for name in ClipRow.__struct_fields__)) for row in rows]
    write_whole(out / ALL, json_of(TriageFile(_counts(rows), tabled, lessons)))
    plain = [msgspec.to_builtins(row) for row in tabled]
    head = [key for key in plain[0] if key != "located_percent"]
    methods = sorted({name for row in rows for name in row.located_percent})
    table = [[row[key] for key in head] + [row["located_percent"].get(name) for name in methods] for row in plain]
    write_whole(out / TABLE, csv_of([*head, *(f"{name}.located_percent" for name in methods)], table))
    write_whole(out / NOTE, note(lessons))
    write_whole(out / PAGE, page(out, folder, clips, rows, lessons))


def page(out: Path, folder: Path, clips: Sequence[Clip], rows: Sequence[Row], lessons: Sequence[Lesson]) -> str:
    """Returns the page, which needs no network and no script."""
    groups = [
        {
            "identity": group.name.lower(),
            "title": TITLES[group],
            "cards": [_card(out, clip, row) for clip, row in zip(clips, rows, strict=True) if row.group == group],
        }
        for group in Group
    ]
    template = environment(PACKAGE, REPORT).get_template("triage.html")
    return template.render(
        policy=POLICY,
        generator=GENERATOR,
        css=own_text("page.css"),
        title=folder.resolve().name,
        subtitle=summary(rows),
        groups=[group for group in groups if group["cards"]],
        lessons=[{"lesson": each, "count": counted(len(each.clips), "clip")} for each in lessons],
    )


def summary(rows: Sequence[Row]) -> str:
    """Returns how many clips each group has, in one line."""
    counts = _counts(rows)
    parts = [f"{counts[group]} {group}" for group in reversed(Group) if counts[group]]
    return f"{counted(len(rows), 'clip')}: {', '.join(parts)}"


def note(lessons: Sequence[Lesson]) -> str:
    """Returns how to film, by what failed, as Markdown."""
    if not lessons:
        return "# How to film\n\nNo clip has to be filmed again.\n"
    lines = [f"- {each.advice} ({counted(len(each.clips), 'clip')}: {each.cause})" for each in lessons]
    return "\n".join(
        ["# How to film", "", "Made from the clips that failed, the most frequent cause first.", "", *lines, ""]
    )


def opening(out: Path, clip: Clip, row: Row) -> str:
    """Returns the command that opens a clip at its frame; empty where it cannot be opened."""
    if row.group == Group.UNOPENED:
        return ""
    run = Path(clip.source) if clip.is_run or not row.complete else out / row.run
    at = f" --at {row.frame}" if row.frame else ""
    return f"ispom app {shlex.quote(str(run.absolute()))}{at}"


def _card(out: Path, clip: Clip, row: Row) -> dict[str, Any]:
    located = [
        f"{colours.label(name)} {'–' if share is None else f'{share:g} %'}"
        for name, share in row.located_percent.items()
    ]
    better = f"{row.setting}: {row.gain}" if row.setting and row.gain else ""
    return {
        "row": row,
        "action": "" if row.action in (Action.NOTHING, Action.LOOK) else str(row.action),
        "trouble": TROUBLE.get(row.group, "trouble at"),
        "better": better,
        "located": f"located: {', '.join(located)}" if located else "",
        "open": opening(out, clip, row),
    }


def _counts(rows: Sequence[Row]) -> dict[str, int]:
    return {str(group): sum(row.group == group for row in rows) for group in Group}
