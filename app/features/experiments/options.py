"""The options of `ispom experiment`, and those that it shares with `ispom gate` and `ispom triage`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...engine.options import FirstFrames, Name


@dataclass(frozen=True, kw_only=True)
class Parallel:
    """Where the runs of a command are computed."""

    workers: int | None = None
    """Runs at the same time, a process with one thread each, by Dask: 0 runs one after the other in this process.
    Default: one for each core, or 0 with --shard or where Dask is not installed."""
    memory_gb: float = 4.0
    """Memory of a worker [GB]: one that needs more is ended, and its run is a row that says so."""
    scheduler: str | None = None
    """Address of a running Dask cluster, such as tcp://head:8786, which sees the same folders; instead of workers of
    this machine."""


@dataclass(frozen=True, kw_only=True)
class Sharded(Parallel):
    """Which of the runs of a command are computed."""

    shard: str | None = None
    """K/N computes only every N-th run, from the K-th on, such as 3/40 in an array job, and writes neither tables nor a
    page. The command without it writes them of all runs in the folder, and computes those that are missing."""


@dataclass(frozen=True, kw_only=True)
class Runs(Parallel, FirstFrames):
    """The runs of a plan, and where they are computed: of `ispom experiment` and `ispom gate`."""

    plan: tyro.conf.Positional[str]
    """fig8, fig9, table1, table2, table3, table4 (of the paper), speed (CPU time and memory beside errors), or a YAML
    file as in docs/howto/experiment.md."""
    more: tyro.conf.Positional[tuple[str, ...]] = ()
    """The same as --sources."""
    out: Path
    """Folder to write to: new, empty, or that of an experiment to go on with."""
    sources: tuple[str, ...] = ()
    """Sources instead of the plan's, such as sim:tiny."""
    seeds: str | None = None
    """Seeds instead of the plan's, such as 0-9 or 3,5,8."""
    recordings: bool = False
    """Write run.rrd of each run, too."""


@dataclass(frozen=True, kw_only=True)
class Experiment(Runs, Sharded):
    """Runs sources x methods x settings x seeds, and writes tables, figures and a page with medians and spreads. The
    same command continues where an earlier one was stopped."""

    plan: tyro.conf.Positional[str]
    """fig8, fig9, table1, table2, table3, table4 (of the paper), speed (CPU time and memory beside errors), a YAML file
    as in docs/howto/experiment.md, or faults: known faults are put onto the sources, and a table says what methods and
    doctor make of them."""
    merge: bool = False
    """Compute nothing: table the runs that are in the folder, a missing one as a failed row."""
    fault: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Of faults: NAME or NAME:SETTING=VALUE,... as in docs/howto/faults.md; can be given several times. Default: all
    that suit a source. healthy is none."""
    stretches: str = "1"
    """Of faults: frames such as 0-44,105-149, or a number of stretches of 45 frames, even along the recording."""
    methods: tuple[Name, ...] = ()
    """Of faults: methods to run. Default: all default ones that the source has the cameras for."""
    doctor_only: bool = False
    """Of faults: run no method."""
    table: Path | None = None
    """Of faults: a Markdown file, in which the table is written between its two marks, too."""
