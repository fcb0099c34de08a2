"""What runs of an experiment will miss, found before the first of them: sources, sensors and packages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import Rig

from .plan import Plan, Run, config_of


def missing(plan: Plan, runs: Iterable[Run]) -> Iterator[str]:
    """Yields a sentence for each source that cannot be opened, and for each line whose method cannot be made for one:
    that of the error. No image is read."""
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
