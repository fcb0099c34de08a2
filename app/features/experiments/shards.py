"""Parts of an experiment, which several commands compute in one folder: array jobs, Snakemake, GNU parallel.

A part writes the folders of its runs and, when it is over, `shards/K-of-N.json` with the sentence of each run that
failed. It writes no tables, which all parts would share.
"""

from __future__ import annotations

import json
import random
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from ispom.errors import InputError
from ispom.io.files import exists, is_folder, names
from ispom.io.rows import read_text
from ispom.io.whole import require_no_links

from ...engine.outputs import json_text
from ...engine.run_folder.run_folder import LOCK, is_locked
from .row import Row

FOLDER = "shards"
MOST_SHARDS = 100_000
ATTEMPTS, PAUSE_S = 6, 0.2
"""Parts that start at the same time make the folder at the same time: one that meets a half-made one tries again."""
T = TypeVar("T")
MISSING = "not computed: run its shard again, or the command without --merge"


@dataclass(frozen=True)
class Shard:
    """One of `count` parts; `number` counts from 1."""

    number: int
    count: int

    def of(self, runs: Sequence[T]) -> list[T]:
        """Returns its runs: every count-th, as neighbours in a plan take a similar time."""
        return list(runs[self.number - 1 :: self.count])

    @property
    def file(self) -> Path:
        """Within the folder of the experiment."""
        return Path(FOLDER) / f"{self.number}-of-{self.count}.json"


class Report(msgspec.Struct, forbid_unknown_fields=True):
    """The file of a part."""

    runs: list[str]
    """Folders of its runs."""
    failures: dict[str, str]
    """One sentence by folder."""


def shard_of(text: str) -> Shard:
    """Reads K/N. Raises InputError for anything else."""
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text.strip(), re.ASCII)
    number, count = map(int, match.groups()) if match else (0, 0)
    if not 1 <= number <= count <= MOST_SHARDS:
        raise InputError(f"--shard is {text[:40]!r}: give K/N, with K from 1 to N, such as 3/40")
    return Shard(number, count)


def report_text(rows: Sequence[Row]) -> str:
    """Returns the file of a part that is over."""
    failures = {row.run.folder.as_posix(): row.failure for row in rows if row.failure is not None}
    return json_text({"runs": [row.run.folder.as_posix() for row in rows], "failures": failures}, 1)


def failures(out: Path) -> dict[str, str]:
    """Returns the sentences of all parts that are over, by folder. Raises InputError for a damaged file."""
    found: dict[str, str] = {}
    folder = out / FOLDER
    require_no_links(out, folder / "any")
    for name in sorted(names(folder)) if exists(folder) and is_folder(folder) else ():
        if name.endswith(".json") and not name.startswith("."):
            try:
                report = msgspec.convert(json.loads(read_text(folder / name)), Report)
            except (ValueError, msgspec.ValidationError):
                raise InputError(f"{folder / name} is damaged: remove it, and run its shard again") from None
            found |= report.failures
    return found


def running(out: Path) -> str | None:
    """Returns the name of a part that is being computed in the folder now, such as 3-of-40; None without any."""
    folder = out / FOLDER
    require_no_links(out, folder / "any")
    for name in sorted(names(folder)) if exists(folder) and is_folder(folder) else ():
        if name.startswith(".") and name.endswith(LOCK):
            file = folder / name[1 : -len(LOCK)]
            if is_locked(file):
                return file.stem
    return None


def retried(make: Callable[[], None]) -> None:
    """Calls `make`, again where another part that starts at the same time is in its way."""
    for attempt in range(ATTEMPTS):
        try:
            return make()
        except InputError:
            if attempt == ATTEMPTS - 1:
                raise
            time.sleep(PAUSE_S * (attempt + random.random()))
