"""The command line's options, as values. Fields of the configs become flags too: `--monocular.scale-transfer norm`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from ispom.estimators import Config, IntegratedConfig, Method, MonocularConfig, StereoConfig, Variant
from ispom.sequences import open_sequence
from ispom.types import Sequence


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every command takes."""

    methods: tuple[Method, ...] = ()
    """Methods to run; none given means all that the source has the cameras for."""
    variant: Variant = "paper"
    """Which implementation of the methods: `paper` is as printed."""
    stereo_every: int = 1
    """Of a stereo recording, every K-th pair is stereo; every left image is video."""
    video_scale: float = 1.0
    """Of a stereo recording, size of the video images relative to the left images, up to 1."""
    seed: int = 0
    """Seed of a simulation."""
    max_exposures: int | None = None
    """Use only the first N exposures."""
    monocular: MonocularConfig = field(default_factory=MonocularConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    integrated: IntegratedConfig = field(default_factory=IntegratedConfig)

    @property
    def config(self) -> Config:
        return Config(self.monocular, self.stereo, self.integrated)

    def open(self, source: str) -> Sequence:
        """The sequence of a source, shaped by these options; InputError where that cannot be."""
        return open_sequence(
            source,
            stereo_every=self.stereo_every,
            video_scale=self.video_scale,
            seed=self.seed,
            max_exposures=self.max_exposures,
        )


@dataclass(frozen=True, kw_only=True)
class Serve(Options):
    """What the app takes besides."""

    host: str = "127.0.0.1"
    """Address to listen on; any other than this one lets other machines in."""
    port: int = 8090
    """Port of the page; where it is taken, the next free one."""
    browser: bool = True
    """Open the page in a browser."""


@dataclass(frozen=True, kw_only=True)
class Demo(Serve):
    """Opens the app on the simulated experiment (sim:city)."""


@dataclass(frozen=True, kw_only=True)
class App(Serve):
    """Opens the app on a source."""

    source: tyro.conf.Positional[str]
    """sim:NAME, or the folder of a drive such as kitti/sequences/06."""


@dataclass(frozen=True, kw_only=True)
class Run(Options):
    """Runs the methods over a source without a window, and writes trajectories, metrics and a recording."""

    source: tyro.conf.Positional[str]
    """sim:NAME, or the folder of a drive such as kitti/sequences/06."""
    out: Path | None = None
    """Folder to write to; without it, a new one below recordings/."""
    frame: Literal["rig", "left", "video"] = "rig"
    """The frame whose poses are written."""
    recording: bool = True
    """Write run.rrd, which any Rerun viewer opens."""
