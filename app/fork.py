"""`ispom fork`: a run again from its own settings up to an exposure, and with others from there on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import tyro

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.io.files import exists, expanded
from ispom.methods import with_asked
from ispom.sequences.address import is_address, is_device, without_secrets

from .headless.command import run as run_headless
from .headless.job import Origin
from .options import Fork, Run, config_of, settings_of
from .run.folder.run_file import RunFile, read_run_file
from .run.playback import Builder, Stage

_SOURCE_OPTIONS = {"seed": int, "stereo_every": int, "video_scale": (float, int), "max_exposures": int, "camera": str}


def fork(options: Fork, arguments: Sequence[str], builder: Builder = build) -> int:
    """Runs the fork; `arguments` are those of the command, read again with the settings of the run as defaults.

    Raises InputError where the run cannot be repeated, or as `ispom run`.
    """
    run = read_run_file(options.run)
    config = run.configs()
    options = tyro.cli(Fork, prog="ispom fork", args=arguments, default=replace(options, settings=settings_of(config)))
    if options.at < 0:
        raise InputError(f"--at is {options.at}: give an exposure of the run, counted from 0")
    stages = tuple(stage for stage in run.earlier if stage.until < options.at)
    here = next((s for s in run.earlier if s.until >= options.at), Stage(0, with_asked(run.methods), config))
    if options.at:
        stages = (*stages, replace(here, until=options.at))
    again = Run(
        source=_source(options, run),
        methods=options.methods or run.methods,
        settings=settings_of(config_of(options.settings)),
        out=options.out,
        recording=options.recording,
        **_options(run),
    )
    return run_headless(again, builder, Origin(run, options.run, stages))


def _source(options: Fork, run: RunFile) -> str:
    source = options.source or run.source
    if is_device(source) or is_address(source):
        raise InputError(
            f"the run was live, on {without_secrets(source)}, and its images are gone: fork a run on files"
        )
    if not source.startswith("sim:") and not exists(expanded(source)):
        raise InputError(f"{source}, the source of the run, is not there: give --source with where it is now")
    return source


def _options(run: RunFile) -> dict[str, Any]:
    """Its frame, and how it opened its source; InputError for what `ispom run` does not write."""
    found: dict[str, Any] = {"frame": run.frame}
    for name, kind in _SOURCE_OPTIONS.items():
        value = run.options.get(name)
        if value is not None and not isinstance(value, kind):
            raise InputError(f"run.yaml: {name} is {str(value)[:40]!r}: restore the file, or run again")
        if value is not None:
            found[name] = Path(value) if name == "camera" else value
    return found
