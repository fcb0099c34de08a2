"""passport.json: what it holds, and how a stranger's is read. Nothing in it is trusted."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from ispom.errors import InputError
from ispom.io.files import exists, is_folder, read_bytes

from ...engine.outputs import MARKER, mark_text, signature
from ...engine.run_folder.own import is_signed, signed
from ...engine.run_folder.run_file import RunFile, RunFrame

COMMAND, PASSPORT = "passport", "passport.json"
VERSION = 1
Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
Count = Annotated[int, Meta(ge=0, le=2**53)]
"""JSON's numbers are whole up to there in every program."""
Place = Literal["source", "camera", "sensors"]


class InputFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file that the source reads."""

    place: Place
    """What `name` begins at: the folder of the source, or that of the file that was given by --camera or --sensors."""
    name: Annotated[str, Meta(max_length=4096)]
    """Relative, with slashes. It is compared with the names of the files that a source reads, and opened only below
    `place`."""
    bytes: Count
    sha256: Sha256


class Source(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the run was on."""

    address: str
    """As it was given: a path on the machine of the run, or `sim:NAME`."""
    sequence: str
    """Its name."""
    notes: tuple[str, ...]
    """What the source says about itself, such as a guessed calibration."""
    frames: dict[str, Count]
    """Number of measurements by kind."""
    images_sha256: Sha256
    """Of the time, size and pixels of all images, as in run.yaml."""
    files: tuple[InputFile, ...]
    """Every file that the source reads, sorted; none of a simulation that names none."""


class RunOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Options of `ispom run`, without those that say what is written."""

    methods: tuple[str, ...]
    frame: RunFrame
    seed: Count
    stereo_every: Count
    video_scale: float
    scale_calibration: bool
    max_exposures: Count | None
    until: str | None
    camera: str | None
    """Name of the file: below the folder of the source, or without a folder where it lies elsewhere."""
    sensors: str
    """auto, none, or a name as `camera`."""
    topics: tuple[str, ...] = ()


class Stage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What ran before a fork."""

    at: Count
    """First frame that had other settings or methods."""
    methods: tuple[str, ...]
    config: dict[str, Any]


class Machine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the run was made with; empty texts where it does not say."""

    versions: dict[str, str]
    platform: str
    processor: str


class Output(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What one method gave."""

    method: str
    unit: Literal["metric", "own"]
    """Whether lengths are in metres, or in a unit of the method's own."""
    poses: Count
    poses_sha256: Sha256
    """Of METHOD.tum, byte by byte: a line `time tx ty tz qx qy qz qw` for each final pose world_from_FRAME, nine
    decimals."""
    steps_sha256: Sha256
    """Of the method's rows of steps.csv in UTF-8: exposure, time_ns, status, x, y, z, qx, qy, qz, qw, and the digests,
    with commas between them and a line end after each row. Numbers have all digits."""
    length: float
    """Of the path through the final poses."""
    sigma_position: float | None
    """Median standard deviation of the live positions along their worst axis; null where the method states none."""
    sigma_deg: float | None
    """The same of the orientations [deg]."""
    figures: dict[str, Any]
    """The method's part of metrics.json."""


class Passport(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of passport.json."""

    version: Literal[1]
    """Of this format."""
    source: Source
    options: RunOptions
    config: dict[str, Any]
    """By method: every setting, of those that ran for others too."""
    forked: tuple[Stage, ...]
    """What ran before this run's own settings, oldest first; empty for a run that is no fork."""
    machine: Machine
    path_length_m: float | None
    """Of the ground truth; null without one."""
    outputs: Annotated[tuple[Output, ...], Meta(min_length=1)]

    def run_file(self, methods: tuple[str, ...]) -> RunFile:
        """The run of these of its methods, as run.yaml describes it."""
        options = msgspec.to_builtins(self.options) | {"methods": list(methods), "topics": list(self.options.topics)}
        forked: list[Mapping[str, Any]] = [
            {"run": "", "at": stage.at, "methods": list(stage.methods), "config": stage.config} for stage in self.forked
        ]
        source, machine = self.source, self.machine
        return RunFile(
            source.address, source.sequence, options, self.config, list(source.notes), source.frames,
            images_sha256=source.images_sha256, versions=machine.versions, platform=machine.platform,
            processor=machine.processor, forked=forked,
        )  # fmt: skip


def read_passport(folder: Path) -> Passport:
    """Reads the file of a folder. Raises InputError where there is none, or it is not as written."""
    path = folder / PASSPORT
    if not exists(folder) or not is_folder(folder) or not exists(path):
        raise InputError(f"{folder} holds no passport (no {PASSPORT}): give a folder that `ispom passport` wrote")
    try:
        return msgspec.json.decode(read_bytes(path), type=Passport)
    except (ValueError, RecursionError, msgspec.MsgspecError) as fault:
        raise InputError(
            f"{path} is not as `ispom passport` writes it ({fault}): restore the file, or use the version that wrote it"
        ) from None


def require_no_files(where: Path, run: RunFile) -> None:
    """Raises InputError where a setting names a file: a passport knows the files of its source only."""
    for name in run.files_named():
        raise InputError(f"{where}: --{name.replace('_', '-')} names a file, which a passport cannot: run without it")


def mark_of(content: bytes) -> str:
    """Returns the file that says whose folder it is, and on which machine this passport.json was written."""
    return signed(f"{signature(COMMAND)}.\n{sha256(content).hexdigest()}\n")


def is_own(folder: Path) -> bool:
    """Whether this program wrote the passport of a folder on this machine, and nobody changed it since."""
    mark = folder / MARKER
    try:
        text = mark_text(mark) if mark.is_file() else ""
        return is_signed(text) and sha256(read_bytes(folder / PASSPORT)).hexdigest() in text.splitlines()
    except OSError:
        return False
