"""A run or a recording that is over, as it is opened for review, and where its source is now."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ispom.ensemble import Ensemble
from ispom.errors import InputError, UnreadableImage
from ispom.io.files import Places, confined, exists, expanded, is_below
from ispom.methods import Config
from ispom.sequences.address import is_address, is_device, without_secrets
from ispom.sequences.recorded_sensors import AUTO, NONE
from ispom.types import Measurement, Rig, Sequence, Trajectory

from ...engine.history.record import ExposureRecord
from ...engine.options import SourceOptions
from ...engine.playback import Playback
from ...engine.run_folder.run_file import RunFile
from ...engine.run_folder.run_folder import RUN
from ...engine.run_folder.statistics import ImagesDigest


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
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Of a recording alone, as `Opened` has them."""


def nobody(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """No estimators, where there is nothing to compute."""
    return Ensemble((), {})


_KINDS = {
    "seed": int,
    "stereo_every": int,
    "video_scale": (float, int),
    "scale_calibration": bool,
    "max_exposures": int,
    "camera": str,
    "sensors": str,
    "topics": list,
}


@dataclass(frozen=True)
class StoredSource:
    """A run's source, which may be opened."""

    source: str
    options: SourceOptions
    """How it is opened."""
    places: Places = None
    """Only what lies here is read, links followed: the run's folder is somebody else's. None: anything."""

    def open(self) -> Sequence:
        """As `SourceOptions.open`."""
        with confined(self.places):
            return self.options.open(self.source)

    def opened(self) -> Sequence:
        """As `SourceOptions.opened`."""
        with confined(self.places):
            return self.options.opened(self.source)


OPTION = "give --source with where it is now"


def stored_source(
    folder: Path, run: RunFile, moved_to: str | None = None, named: Collection[str] = (), cure: str = OPTION
) -> StoredSource:
    """Where the images of a run are, and what of the disk may be read for them. Every command, the page, and agents ask
    this.

    What a run.yaml that was not written on this machine names is opened only in the run's own folder, or where a person
    named it: as `moved_to`, or among the sources `named` before. InputError, with the `cure`, for anything else, and
    where the images are gone.
    """
    source = moved_to or run.source
    if is_device(source) or is_address(source):
        raise InputError(
            f"the run was live, on {without_secrets(source)}, and its images are gone: fork a run on files"
        )
    simulated, options = source.startswith("sim:"), source_options(run)
    given = moved_to is not None or source in named
    places = None if run.own else (folder,)
    if places is not None:
        allowed = (*places, place_of(expanded(source))) if given and not simulated else places
        sensors = None if options.sensors in (AUTO, NONE) else options.sensors
        files: dict[str, Path | str | None] = {"source": None if simulated or given else source}
        files |= {"camera": options.camera, "sensors": sensors, **run.files_named()}
        for name, file in files.items():
            if file is not None and not is_below(expanded(file), allowed):
                how = cure if name == "source" else "copy it into the folder of the run"
                raise InputError(
                    f"{folder / RUN} was not written on this machine, or was changed since, and names as {name} "
                    f"{str(file)[:200]}, outside of its folder: {how}"
                )
    if not simulated and not exists(expanded(source)):
        raise InputError(f"{source}, the source of the run, is not there: {cure}")
    return StoredSource(source, options, None if given else places)


def place_of(source: Path) -> Path:
    """The folder in which a source's other files are."""
    return source if source.is_dir() else source.parent


def compared(sequence: Sequence, expected: str, source: str) -> Sequence:
    """The sequence, whose images are read once and compared with those of the run before the first one is given.

    They are those whose digest is `expected`, all or the first ones. Where they are not, none can be read.
    """
    same: bool | None = None

    def load(i: int) -> Measurement:
        nonlocal same
        if same is None:
            same = _are_of(sequence, expected)
        if not same:
            raise UnreadableImage(f"the images of {source} are not those that the run saw: give the run's own")
        return sequence.load(i)

    return replace(sequence, load=load)


def _are_of(sequence: Sequence, expected: str) -> bool:
    found = ImagesDigest()
    for i in range(len(sequence)):
        with suppress(UnreadableImage):  # nor could the run read it
            found.add(sequence.load(i))
        if found.hexdigest() == expected:
            return True
    return False


def source_options(run: RunFile) -> SourceOptions:
    """How it opened its source; InputError for what `ispom run` does not write."""
    found: dict[str, Any] = {"sensors": NONE}  # of runs before sources had sensors by themselves
    for name in (each.name for each in fields(SourceOptions)):
        value = run.options.get(name)
        if value is not None and not isinstance(value, _KINDS[name]):
            raise InputError(f"run.yaml: {name} is {str(value)[:40]!r}: restore the file, or run again")
        if value is not None:
            found[name] = Path(value) if name in ("camera", "sensors") else value
            if name == "topics":
                found[name] = tuple(map(str, value))
    return SourceOptions(**found)
