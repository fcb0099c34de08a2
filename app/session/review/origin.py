"""What a run was on: its source, opened again as the run opened it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import exists, expanded
from ispom.sequences.address import is_address, is_device, without_secrets

from ...engine.options import SourceOptions
from ...engine.run_folder.run_file import RunFile

_KINDS = {"seed": int, "stereo_every": int, "video_scale": (float, int), "max_exposures": int, "camera": str}


def source_of(run: RunFile, moved_to: str | None = None) -> str:
    """Where its images are; InputError where they are gone."""
    source = moved_to or run.source
    if is_device(source) or is_address(source):
        raise InputError(
            f"the run was live, on {without_secrets(source)}, and its images are gone: fork a run on files"
        )
    if not source.startswith("sim:") and not exists(expanded(source)):
        raise InputError(f"{source}, the source of the run, is not there: give --source with where it is now")
    return source


def source_options(run: RunFile) -> SourceOptions:
    """How it opened its source; InputError for what `ispom run` does not write."""
    found = {}
    for name in (field.name for field in fields(SourceOptions)):
        value = run.options.get(name)
        if value is not None and not isinstance(value, _KINDS[name]):
            raise InputError(f"run.yaml: {name} is {str(value)[:40]!r}: restore the file, or run again")
        if value is not None:
            found[name] = Path(value) if name == "camera" else value
    return SourceOptions(**found)
