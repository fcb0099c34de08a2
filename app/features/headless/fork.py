"""`ispom fork`: a run again from its own settings up to a frame, and with others from there on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import tyro

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.io.files import confined
from ispom.methods import Config, with_dependencies

from ...engine.options import config_of, settings_of
from ...engine.playback import Builder, Stage
from ...engine.run_folder.run_file import read_run_file
from ...session.review.stored import stored_source
from .command import run as run_headless
from .job import Origin
from .options import Fork, Run


def fork(options: Fork, words: Sequence[str], builder: Builder = build) -> int:
    """Runs the fork; `words` are those of the command, read again with the settings of the run as defaults.

    Raises InputError where the run cannot be repeated, or as `ispom run`.
    """
    run = read_run_file(options.run)
    config = run.configs()
    default = replace(options, settings=settings_of(config, type(options.settings)))
    options = tyro.cli(type(options), prog="ispom fork", args=words, default=default)
    if options.at < 0:
        raise InputError(f"--at is {options.at}: give a frame of the run, counted from 0")
    stages = tuple(stage for stage in run.earlier if stage.until < options.at)
    here = next((s for s in run.earlier if s.until >= options.at), Stage(0, with_dependencies(run.methods), config))
    stages = (*stages, replace(here, until=options.at))
    found = stored_source(options.run, run, options.source)
    again = Run(
        source=found.source,
        methods=options.methods or run.methods,
        settings=settings_of(Config({**config.given, **config_of(options.settings).given})),
        out=options.out,
        recording=options.recording,
        frame=run.frame,
        **vars(found.options),
    )
    with confined(found.places):
        return run_headless(again, builder, Origin(run, options.run, stages))
