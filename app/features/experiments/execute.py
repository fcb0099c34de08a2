"""One run of an experiment, in whatever process: by `ispom run`'s own way, in a run folder. And what it will miss."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.io.whole import require_no_links
from ispom.methods import with_dependencies
from ispom.sequences import open_sequence
from ispom.types import Rig

from ...engine.options import settings_of
from ...engine.playback import Builder
from ...engine.run_folder.run_file import read_run_file, versions
from ..headless.command import completed
from ..headless.console import Progress, silent
from ..headless.options import Run as Options
from .plan import Plan, Run, config_of
from .row import Row, row_of


def execute(
    plan: Plan, run: Run, out: Path, recording: bool = False, builder: Builder = build, progress: Progress = silent
) -> Row:
    """The row of a run that is computed now. What goes wrong with it is in the row; only a signal is raised."""
    folder = out / run.folder
    options = Options(
        source=run.source,
        out=folder,
        recording=recording,
        methods=(run.line.method,),
        settings=settings_of(config_of(run.line)),
        seed=run.seed,
        stereo_every=plan.stereo_every,
        video_scale=plan.video_scale,
        max_exposures=plan.max_exposures,
    )
    try:
        require_no_links(out, folder / "any")
        completed(options, builder, progress=progress)
        row = row_of(run, folder)
    except InputError as error:
        return Row(run, str(error))
    except Exception as error:
        return Row(run, printable(f"{type(error).__name__}: {error}"))
    if row is None:
        raise RuntimeError(f"{folder} is incomplete, though its run came to its end")
    return row


def finished_before(plan: Plan, run: Run, out: Path) -> Row | None:
    """The row of a run that an earlier command completed, or None.

    InputError where that run had other settings, or was computed by other versions of the libraries.
    """
    folder = out / run.folder
    row = row_of(run, folder)
    if row is None:
        return None
    written, config = read_run_file(folder), config_of(run.line)
    expected = {
        "source": run.source,
        "seed": run.seed,
        "stereo_every": plan.stereo_every,
        "video_scale": plan.video_scale,
        "max_exposures": plan.max_exposures,
        "config": {name: asdict(config.of(name)) for name in with_dependencies([run.line.method])},
    }
    earlier = {"source": written.source, **written.options, "config": dict(written.config)}
    if other := next((name for name, value in expected.items() if earlier.get(name) != value), None):
        raise InputError(f"{folder} holds a run with another {other}: give a new --out, or remove that folder")
    now = versions()
    if other := next((name for name, value in now.items() if written.versions.get(name) != value), None):
        was = written.versions.get(other, "none")
        raise InputError(f"{folder} was computed with {other} {was}, now it is {now[other]}: give a new --out")
    return row


def missing(plan: Plan, runs: Iterable[Run]) -> Iterator[str]:
    """Yields a sentence for each source that cannot be opened, and for each line whose method cannot be made for one:
    that of the error. Before the first run; no image is read."""
    opened, tried = dict[str, Rig | None](), set[tuple[str, str]]()
    for run in runs:
        if (run.source, run.line.name) in tried:
            continue
        tried.add((run.source, run.line.name))
        if run.source not in opened:
            try:
                opened[run.source] = open_sequence(
                    run.source, stereo_every=plan.stereo_every, video_scale=plan.video_scale, seed=run.seed
                ).rig
            except InputError as error:
                opened[run.source] = None
                yield str(error)
        rig = opened[run.source]
        if rig is None:
            continue
        try:
            build(config_of(run.line), (run.line.method,), rig)
        except InputError as error:
            yield f"{run.line.name}: {error}"
