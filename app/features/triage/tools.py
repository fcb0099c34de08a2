"""What a triage found, for agents: it was made before, as runs are written to the disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec

from ispom.errors import InputError
from ispom.io.files import confined, is_below

from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, page_of
from .row import ClipRow, Group
from .written import ALL, read_triage


def triage(
    agents: AgentSession,
    folder: Annotated[str, "Folder of a triage, in the folder of runs; empty for the latest one."] = "",
    group: Annotated[str, "Only clips of this group, such as `lost`; empty for all."] = "",
    start: Annotated[int, "Row to begin with."] = 0,
    limit: Annotated[int, "Number of rows, at most 200."] = 50,
) -> dict[str, Any]:
    """Says what `ispom triage` found in a folder of clips: `groups` counts those that are fine, lost, without a map,
    suspicious, or cannot be opened; a row has the cause, what to do, the best frame to look at, and `open`, the key of
    its run for open_run. `how_to_film` has the remedy of each cause once. It runs nothing: a person makes the triage by
    `ispom triage CLIPS --out FOLDER`, with FOLDER in the folder of runs. Its schema is that of triage.json."""
    if group and group not in set(Group):
        raise InputError(f"{group[:60]!r} is no group: give one of {', '.join(Group)}")
    place = agents.file(folder) if folder else _latest(agents)
    with confined(agents.places):
        found = read_triage(place)
    rows = [row for row in found.clips if group in ("", row.group)]
    page = page_of(rows, start, limit)
    runs, keys = agents.runs.absolute(), agents.keys

    def key(row: ClipRow) -> str | None:
        run = (place / row.run).absolute()
        name = run.relative_to(runs).as_posix() if row.run and run.is_relative_to(runs) else ""
        return name if name in keys else None

    listed = [msgspec.to_builtins(row) | {"open": key(row)} for row in page["rows"]]
    return {
        "folder": str(place),
        "groups": found.groups,
        "how_to_film": msgspec.to_builtins(found.how_to_film),
        **page,
        "rows": listed,
    }


def _latest(agents: AgentSession) -> Path:
    files = [path for path in agents.runs.rglob(ALL) if is_below(path, agents.places)]
    if not files:
        raise InputError(f"no triage is in {agents.runs}: run `ispom triage CLIPS --out {agents.runs / 'triage'}`")
    return max(files, key=lambda path: path.stat().st_mtime_ns).parent


TOOLS = (Tool(triage),)
