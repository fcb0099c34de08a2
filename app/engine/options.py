"""Options that several commands share. Settings of the methods are flags: `--monocular.paper.scale-transfer unit`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, make_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from ispom.calibration.opening import open_guessed, with_estimated_camera
from ispom.errors import InputError
from ispom.io.files import expanded
from ispom.methods import BUILT_IN, GROUPS, Config, Variant, members, method, names
from ispom.sequences.policy import ANY_SOURCE, SourcePolicy
from ispom.sequences.recorded_sensors import AUTO
from ispom.types import Sequence

from .run_folder.run_folder import is_unfinished


def _field(name: str) -> str:
    """Returns the name of the field with a method's settings: `monocular_paper` for `monocular.paper`."""
    return name.replace(".", "_").replace("-", "_")


def _named(words: list[str]) -> str:
    """Raises InputError for a word that is neither a method nor a group."""
    (word,) = words
    if word in GROUPS or word in names():
        return word
    near = get_close_matches(word, names(), 2, 0.5)
    nearest = f" The nearest are {' and '.join(near)}." if near else ""
    raise InputError(
        f"{word[:60]!r} is no method.{nearest} Choose from {', '.join(SHOWN)}, the groups {' and '.join(GROUPS)}, and "
        "the others in docs/methods/index.md; or name a program by --external"
    )


SHOWN = tuple(name for name in BUILT_IN if name not in GROUPS["paper"])
"""Methods that the help names; all of them would be too many for a line of each command."""
Name = Annotated[
    str,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="|".join((*SHOWN, *GROUPS, "NAME")),
        instance_from_str=_named,
        is_instance=lambda value: isinstance(value, str),
        str_from_instance=lambda value: [value],
    ),
]
"""A method, or a group of methods."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings of some methods as flags: a field for each, as `--stereo.paper.max-tracks 300`."""

    @staticmethod
    def of(methods: Iterable[str]) -> type[Settings]:
        """Returns the class with a field for each of these methods; none has one in `Settings` itself."""
        configs = {name: method(name).config for name in methods}
        flags: Any = [
            (_field(name), Annotated[config, tyro.conf.arg(name=name)], field(default_factory=config))
            for name, config in configs.items()
        ]
        return make_dataclass("Settings", flags, bases=(Settings,), frozen=True, kw_only=True)


def with_flags(options: type, words: Iterable[str]) -> type:
    """Returns the class of options with flags for the settings of the methods that the words name. If the words have an
    unknown flag, it has the flags of all methods, so that the error message can name the nearest ones. The help lists
    the settings of --methods, or else of the default methods.

    So a command imports only the methods that it uses, and reads the documentation of no other.
    """
    own, words = {f.name for f in fields(options)}, tuple(words)
    if "settings" not in own:
        return options
    flags = {word[2:].partition("=")[0].replace("-", "_") for word in words if word.startswith("--")}
    flags -= own | {f"no_{name}" for name in own} | {"help"}
    owners = {_owner(flag) for flag in flags}
    if {"-h", "--help"} & set(words):
        owners |= set(_after_methods(words) or SHOWN)
    settings = Settings.of(name for name in names() if name in owners or None in owners)
    flag: Any = tyro.conf.arg(name="", prefix_name=False)
    chosen: Any = ("settings", Annotated[settings, flag], field(default_factory=settings))
    described = {"__doc__": options.__doc__}
    return make_dataclass(options.__name__, [chosen], bases=(options,), namespace=described, frozen=True, kw_only=True)


def _after_methods(words: Iterable[str]) -> tuple[str, ...]:
    """Returns the existing methods that the words choose by --methods."""
    found, chooses = list[str](), False
    for word in words:
        option, _, value = word.partition("=")
        if word.startswith("-"):
            chooses = option == "--methods"
        if chooses:
            found.append(value or word)
    return members(word for word in found if word in GROUPS or word in names())


def _owner(flag: str) -> str | None:
    """Returns the method that has a setting of this name, as in `stereo.paper.max_tracks`; None where none has."""
    found = [name for name in names() if flag.startswith(f"{name}.".replace("-", "_"))]
    return max(found, key=len, default=None)


def config_of(settings: Settings) -> Config:
    """Returns the settings of the methods that have flags."""
    return Config({name: getattr(settings, _field(name)) for name in names() if hasattr(settings, _field(name))})


def settings_of(config: Config, flags: type[Settings] | None = None) -> Settings:
    """Returns the settings in the form of flags: of the class `flags`, or of a class with the methods of `config`."""
    if flags is None:
        flags = Settings.of(config.given)
    own = {f.name for f in fields(flags)}
    return flags(**{_field(name): config.of(name) for name in names() if _field(name) in own})


@dataclass(frozen=True, kw_only=True)
class Programs:
    """Options for methods that are external programs."""

    external: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME[:video|stereo|video+stereo]=COMMAND: a program of yours as the method NAME, as described in
    docs/reference/external_programs.md; can be given several times. It steps on video by default."""


@dataclass(frozen=True, kw_only=True)
class ReadsRuns:
    """Options of a command that reads files of runs. Before it begins, `cli/commands.py` finishes the files of runs
    that were killed."""

    READS: ClassVar[tuple[str, ...]] = ("run",)
    """The fields that name folders of runs."""
    repair: bool = False
    """Where a run was killed, finish its files first, as far as it came. Without this, a person on a terminal is
    asked, and elsewhere the run is refused."""

    def unfinished(self) -> tuple[Path, ...]:
        """Returns the named folders with a run that was killed or is still going on."""
        return tuple(path for path in self._read() if is_unfinished(path))

    def _read(self) -> tuple[Path, ...]:
        values = [getattr(self, name) for name in self.READS]
        named = [each for value in values for each in (value if isinstance(value, tuple) else (value,))]
        return tuple(dict.fromkeys(expanded(each) for each in named if str(each)))


@dataclass(frozen=True, kw_only=True)
class MovedSource:
    """Options of a command that opens the source of a run again."""

    source: str | None = None
    """Where the run's source is now, if it has been moved."""


@dataclass(frozen=True, kw_only=True)
class FirstFrames:
    """How much of a source is used."""

    max_exposures: int | None = None
    """Use only the first N frames of each source."""


@dataclass(frozen=True, kw_only=True)
class SourceOptions(FirstFrames):
    """How a source is opened."""

    stereo_every: int = 1
    """Use every K-th pair of a stereo recording as stereo, and every left image as video."""
    video_scale: float = 1.0
    """Size of the video images of a stereo recording relative to its left images, up to 1."""
    seed: int = 0
    """Seed of a simulation."""
    camera: Path | None = None
    """Calibration (a camera.yaml) of a live camera; of images or a video, instead of the file next to them."""
    scale_calibration: bool = False
    """A calibration that is for images of another size of the same shape is scaled to the images."""
    sensors: Path = AUTO
    """Other sensors (IMU, GNSS, wheels): auto (those that lie in or beside the source), none, or a YAML file that names
    their files, as described in docs/reference/source_files.md."""
    topics: tuple[str, ...] = ()
    """Topics of a bag: left=TOPIC right=TOPIC, or video=TOPIC. Without them, names and calibrations show which are
    used."""

    def open(self, source: str, policy: SourcePolicy = ANY_SOURCE) -> Sequence:
        """Returns the sequence of a source with these options. Without a calibration it has the camera that its images
        describe. InputError where the source cannot be opened, or `policy` forbids it."""
        return with_estimated_camera(self.opened(source, policy))

    def opened(self, source: str, policy: SourcePolicy = ANY_SOURCE) -> Sequence:
        """As `open`, but a camera without a calibration is only guessed: to refine the guess takes a while."""
        return open_guessed(
            source,
            stereo_every=self.stereo_every,
            video_scale=self.video_scale,
            seed=self.seed,
            max_exposures=self.max_exposures,
            camera=self.camera,
            scale_calibration=self.scale_calibration,
            policy=policy,
            sensors=self.sensors,
            topics=self.topics,
        )


@dataclass(frozen=True, kw_only=True)
class Options(SourceOptions, Programs):
    """Options of every command that runs methods."""

    methods: tuple[Name, ...] = ()
    """Methods to run, in any combination; none means all of --variant that the source has the cameras for. The groups
    paper and survey stand for all of theirs that it has the cameras for; docs/methods/index.md lists them. With --help,
    the settings of the methods that are named here are listed."""
    variant: Variant | None = None
    """Which methods run where --methods does not say: modern, or paper (exactly as published). Default: modern."""
    settings: Annotated[Settings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Settings)
    """Its class is replaced by `with_flags`."""

    @property
    def of_source(self) -> SourceOptions:
        """Returns the options of the source alone."""
        return SourceOptions(**{f.name: getattr(self, f.name) for f in fields(SourceOptions)})

    @property
    def config(self) -> Config:
        """The settings of the methods."""
        return config_of(self.settings)
