"""Options that several commands share. Settings of the methods are flags: `--monocular.paper.scale-transfer unit`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from ispom.calibration.opening import open_guessed, with_estimated_camera
from ispom.methods import Config, Variant, method, names
from ispom.sequences.policy import ANY_SOURCE, SourcePolicy
from ispom.sequences.recorded_sensors import AUTO
from ispom.types import Sequence


def _field(name: str) -> str:
    """What a method's settings are called as a field: `monocular_paper` of `monocular.paper`."""
    return name.replace(".", "_").replace("-", "_")


if TYPE_CHECKING:
    Name = str
else:
    Name = Literal[names()]


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
    """Returns the class of options with flags for the settings of the methods that the words name: for all of them
    where the words ask for help, or have a flag that is none, whose message names the nearest ones.

    A command imports the methods that it uses only, and reads the documentation of no other.
    """
    own = {f.name for f in fields(options)}
    if "settings" not in own:
        return options
    flags = {word[2:].partition("=")[0].replace("-", "_") for word in words if word.startswith("--")}
    flags -= own | {f"no_{name}" for name in own}
    owners = [_owner(flag) for flag in flags]
    settings = Settings.of(name for name in names() if name in owners or None in owners or "-h" in words)
    flag: Any = tyro.conf.arg(name="", prefix_name=False)
    chosen: Any = ("settings", Annotated[settings, flag], field(default_factory=settings))
    described = {"__doc__": options.__doc__}
    return make_dataclass(options.__name__, [chosen], bases=(options,), namespace=described, frozen=True, kw_only=True)


def _owner(flag: str) -> str | None:
    """Returns the method that has a setting of this name, as in `stereo.paper.max_tracks`; None where none has."""
    found = [name for name in names() if flag.startswith(f"{name}.".replace("-", "_"))]
    return max(found, key=len, default=None)


def config_of(settings: Settings) -> Config:
    """The settings of the methods that have flags."""
    return Config({name: getattr(settings, _field(name)) for name in names() if hasattr(settings, _field(name))})


def settings_of(config: Config, flags: type[Settings] | None = None) -> Settings:
    """The same settings as flags have them: of the class `flags`, or of one that has those of `config`."""
    if flags is None:
        flags = Settings.of(config.given)
    own = {f.name for f in fields(flags)}
    return flags(**{_field(name): config.of(name) for name in names() if _field(name) in own})


@dataclass(frozen=True, kw_only=True)
class Programs:
    """Methods that are programs."""

    external: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME[:video|stereo|video+stereo]=COMMAND: a program of yours as the method NAME, as described in
    docs/reference/external_programs.md; can be given several times. It steps on video by default."""


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """How a source is opened."""

    stereo_every: int = 1
    """Use every K-th pair of a stereo recording as stereo, and every left image as video."""
    video_scale: float = 1.0
    """Size of the video images of a stereo recording relative to its left images, up to 1."""
    seed: int = 0
    """Seed of a simulation."""
    max_exposures: int | None = None
    """Use only the first N frames."""
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
        """The sequence of a source, shaped by these options, with the camera that its images describe where it has no
        calibration; InputError where that cannot be, or may not."""
        return with_estimated_camera(self.opened(source, policy))

    def opened(self, source: str, policy: SourcePolicy = ANY_SOURCE) -> Sequence:
        """As `open`, but a camera without a calibration is a guess: what refines it takes a while."""
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
    """What every command takes."""

    methods: tuple[Name, ...] = ()
    """Methods to run, in any combination; none means all of --variant that the source has the cameras for."""
    variant: Variant | None = None
    """Which methods run where --methods does not say: modern, or paper (exactly as published). Default: modern."""
    settings: Annotated[Settings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Settings)
    """Its class is replaced by `with_flags`."""

    @property
    def of_source(self) -> SourceOptions:
        """Those that say how the source is opened."""
        return SourceOptions(**{f.name: getattr(self, f.name) for f in fields(SourceOptions)})

    @property
    def config(self) -> Config:
        """The settings of the methods."""
        return config_of(self.settings)
