"""`ispom triage`: finds the clips, computes what is not done yet, writes the page, and prints what is not fine."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from ispom.ensemble import build
from ispom.errors import InputError, counted, printable
from ispom.io.files import exists, expanded, is_folder
from ispom.io.rows import read_text
from ispom.io.whole import require_no_links, write_whole
from ispom.methods import Config, choices, members
from ispom.sequences import check_max_exposures

from ...engine import warmup
from ...engine.outputs import claim_folder, json_text
from ...engine.playback import Builder
from ...engine.run_folder.run_file import versions
from ...engine.signals import terminable
from ..experiments.jobs import Jobs, part, shown, take_all, whole, workers_of
from ..experiments.shards import Shard, retried, shard_of
from ..headless.console import compile_first
from .clips import COMMAND, Clip, clips_in
from .execute import Done, Order, execute, failed, unopened
from .options import Triage
from .page import PAGE, opening, summary, write_output
from .row import Group, Row, read_row

ORDER = "order.json"
NOT_FINE = 1
"""Exit code where a clip is not fine."""


def triage(options: Triage, builder: Builder = build) -> int:
    """Computes what is missing, writes the page, and prints a line for each clip that is not fine.

    The exit code is 0 where all are fine. Raises InputError where the folder holds no clip, or the other one something
    else. A signal ends it; the clips that are done are kept.
    """
    folder, out = expanded(options.folder).absolute(), options.out
    if not exists(folder) or not is_folder(folder):
        raise InputError(f"{options.folder} is no folder: give one that holds clips")
    check_max_exposures(options.max_exposures)
    shard = None if options.shard is None else shard_of(options.shard)
    workers = workers_of(options, None if shard is None else 0)
    clips = clips_in(folder, out)
    methods, seconds = choices(options.methods), options.seconds
    order = Order(str(folder), methods, options.max_exposures, options.doctor, seconds)
    retried(lambda: _claim(out, order))
    if shard is not None:
        return _part(options, order, clips, shard, workers, builder)
    with whole(out):
        rows = _completed(options, order, clips, workers, builder)
        write_output(out, folder, clips, rows)
    _print(out, clips, rows)
    return _code(rows)


def _part(options: Triage, order: Order, clips: Sequence[Clip], shard: Shard, workers: int, builder: Builder) -> int:
    """Computes a part of the clips."""
    own = shard.of(clips)
    with part(options.out, shard) as report:
        rows = _completed(options, order, own, workers, builder)
        write_whole(report, json_text({"runs": [clip.folder.as_posix() for clip in own], "failures": {}}, 1))
    said = summary(rows) if rows else counted(0, "clip")
    sys.stdout.write(printable(f"shard {shard.number} of {shard.count}: {said}: {report}") + "\n")
    return _code(rows)


def _completed(options: Triage, order: Order, clips: Sequence[Clip], workers: int, builder: Builder) -> list[Row]:
    """The rows of these clips, in their order."""
    found = {clip: read_row(options.out, clip) for clip in clips}
    # What could not be opened may be so now: a package was installed, a disk is there again.
    before = {clip for clip, row in found.items() if row is not None and row.group != Group.UNOPENED}
    left = [clip for clip in clips if clip not in before]
    failures: dict[Clip, str] = {}

    def take(done: Done) -> None:
        if done.failure is not None:
            failures[done.run] = done.failure

    with terminable() as signals:
        if any(not (clip.problem or clip.is_run) for clip in left):
            compile_first(members(order.methods) or warmup.DEFAULT, Config())
        jobs = Jobs(order, left, options.out, execute, failed)
        done = jobs.computed(options, workers, lambda clip: execute(order, clip, options.out, builder=builder))
        take_all(done, lambda found: shown(found, len(clips), len(before)), take, signals)
    rows = [(clip, read_row(options.out, clip)) for clip in clips]
    return [row or unopened(clip, failures.get(clip, "it was changed meanwhile: run again")) for clip, row in rows]


def _claim(out: Path, order: Order) -> None:
    """Makes the folder, with the order in it; InputError where it holds anything else, or rows of another order."""
    claim_folder(out, COMMAND)
    wanted = json.loads(json.dumps({**asdict(order), "versions": versions()}))
    file = out / ORDER
    require_no_links(out, file)
    if not exists(file):
        write_whole(file, json_text(wanted, 1))
        return
    try:
        written = json.loads(read_text(file))
        other = next((name for name in wanted if written.get(name) != wanted[name]), None)
    except (ValueError, AttributeError):
        raise InputError(f"{file} is damaged: give a new --out") from None
    if other is not None:
        raise InputError(f"{out} holds a triage with another {other.replace('_', '-')}: give a new --out")


def _print(out: Path, clips: Sequence[Clip], rows: Sequence[Row]) -> None:
    lines = []
    for group in Group:
        for clip, row in zip(clips, rows, strict=True):
            if row.group == group != Group.FINE:
                todo = f" -> {row.action}: {row.advice}" if row.advice else ""
                lines.append(f"{group}: {row.clip}: {row.cause}{todo}")
                lines += [f"  {command}"] if (command := opening(out, clip, row)) else []
    lines.append(f"{summary(rows)}: {out / PAGE}")
    sys.stdout.write("\n".join(map(printable, lines)) + "\n")


def _code(rows: Sequence[Row]) -> int:
    return 0 if all(row.group == Group.FINE for row in rows) else NOT_FINE
