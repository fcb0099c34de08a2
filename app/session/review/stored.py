"""A run or a recording that is over, as it is opened for review, and where its source is now."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from ispom.ensemble import Ensemble
from ispom.errors import InputError
from ispom.io.files import exists, expanded
from ispom.methods import Config
from ispom.sequences.address import is_address, is_device, without_secrets
from ispom.types import Rig, Trajectory

from ...engine.history.record import ExposureRecord
from ...engine.options import SourceOptions
from ...engine.playback import Playback
from ...engine.run_folder.run_file import RunFile


@dataclass(frozen=True, eq=False)
class Stored:
    """What is shown of a run or of a recording that is over."""

    path: Path
    """The folder, or the recording."""
    playback: Playback
    """At the first frame: from there it can be replayed, unless `unavailable` says why not."""
    records: Callable[[], Iterator[ExposureRecord]]
    """Every frame that was computed; InputError where one cannot be read."""
    final: Mapping[str, Trajectory]
    """By method: the trajectory that the run ended with, in the method's own world and unit."""
    methods: tuple[str, ...]
    """Whose quantities are known."""
    recording: Path | None = None
    """What Rerun shows of it."""
    recording_id: str = ""
    unavailable: str = ""
    """Why nothing can be computed again, in one sentence; empty where it can."""


def nobody(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """No estimators, where there is nothing to compute."""
    return Ensemble((), {})


_KINDS = {
    "seed": int,
    "stereo_every": int,
    "video_scale": (float, int),
    "max_exposures": int,
    "camera": str,
    "sensors": str,
}


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
            found[name] = Path(value) if name in ("camera", "sensors") else value
    return SourceOptions(**found)
