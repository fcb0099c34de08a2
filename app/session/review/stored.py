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
    """A run or a recording that is over, with everything that is shown of it."""

    path: Path
    """The folder, or the recording."""
    playback: Playback
    """The run at its first frame. It can be replayed from there, unless `unavailable` says why not."""
    records: Callable[[], Iterator[ExposureRecord]]
    """Yields every computed frame. InputError where one cannot be read."""
    final: Mapping[str, Trajectory]
    """By method: the trajectory that the run ended with, in the method's own world and unit."""
    methods: tuple[str, ...]
    """Methods whose quantities are known."""
    recording: Path | None = None
    """The recording that Rerun shows."""
    recording_id: str = ""
    unavailable: str = ""
    """Why nothing can be computed again, in one sentence; empty where it can."""
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """As in `Opened`; only for a recording without a run's folder."""


def nobody(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Returns an ensemble without estimators, for runs that cannot be computed."""
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
    """A run's source that is allowed to be opened."""

    source: str
    options: SourceOptions
    """How it is opened."""
    places: Places = None
    """Folders to which reading is restricted (with links resolved), because the run's folder comes from somebody else.
    None: no restriction."""

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
    """Returns where the images of a run are, and which folders may be read for them. All commands, the page, and agents
    use this function.

    If run.yaml was not written on this machine, its source is opened only in the run's own folder, or if a person named
    it: as `moved_to`, or among the sources `named` before. InputError, with the `cure`, for any other source, and where
    the images are gone.
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
    """Returns the folder with the other files of a source."""
    return source if source.is_dir() else source.parent


def compared(sequence: Sequence, expected: str, source: str) -> Sequence:
    """Returns the sequence, whose images are read and compared with those of the run before the first one is given.

    The digest of all images, or of the first ones, must be `expected`; otherwise no image can be read.
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
        with suppress(UnreadableImage):  # the run could not read it either
            found.add(sequence.load(i))
        if found.hexdigest() == expected:
            return True
    return False


def source_options(run: RunFile) -> SourceOptions:
    """Returns the options with which the run opened its source. InputError for values that `ispom run` never writes."""
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
