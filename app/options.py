"""The command line's options, as values. Settings of the methods are flags: `--monocular.paper.scale-transfer unit`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ispom.calibration.tracked.opened import refined
from ispom.errors import InputError
from ispom.evaluation.ate import Alignment
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.frontends.pair_look import with_look
from ispom.io.files import expanded, is_folder
from ispom.methods import Config, Variant, names, registry
from ispom.sequences import open_sequence
from ispom.sequences.address import without_secrets
from ispom.sequences.policy import ANY_SOURCE, SourcePolicy
from ispom.types import Sequence


def _field(name: str) -> str:
    """What a method's settings are called as a field: `monocular_paper` of `monocular.paper`."""
    return name.replace(".", "_").replace("-", "_")


if TYPE_CHECKING:
    Name = str

    class Settings: ...
else:
    Name = Literal[names()]
    Settings = make_dataclass(
        "Settings",
        [
            (_field(name), Annotated[method.config, tyro.conf.arg(name=name)], field(default_factory=method.config))
            for name, method in registry().items()
        ],
        frozen=True,
        kw_only=True,
    )
"""The configs of all methods, a field each: so every setting is a flag, as in `--stereo.paper.max-tracks 300`."""


def config_of(settings: Settings) -> Config:
    """The settings of all methods."""
    return Config({name: getattr(settings, _field(name)) for name in names()})


def settings_of(config: Config) -> Settings:
    """The same settings as flags have them."""
    return Settings(**{_field(name): config.of(name) for name in names()})


@dataclass(frozen=True, kw_only=True)
class Programs:
    """Methods that are programs."""

    external: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME[:video|stereo|video+stereo]=COMMAND: a program of yours as the method NAME, as described in
    examples/external_program/README.md; can be given several times. It steps on video where nothing is said."""


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
    """Use only the first N exposures."""
    camera: Path | None = None
    """Calibration (a camera.yaml) of a live camera; of images or a video, instead of the file beside them."""

    def open(self, source: str, policy: SourcePolicy = ANY_SOURCE) -> Sequence:
        """The sequence of a source, shaped by these options, with the camera that its images tell where it has no
        calibration; InputError where that cannot be, or may not."""
        return refined(self.opened(source, policy))

    def opened(self, source: str, policy: SourcePolicy = ANY_SOURCE) -> Sequence:
        """As `open`, but a camera without a calibration is a guess: what refines it takes a while."""
        sequence = open_sequence(
            source,
            stereo_every=self.stereo_every,
            video_scale=self.video_scale,
            seed=self.seed,
            max_exposures=self.max_exposures,
            camera=self.camera,
            policy=policy,
        )
        return sequence if source.startswith("sim:") else with_look(sequence)  # those of a simulation are right


@dataclass(frozen=True, kw_only=True)
class Options(SourceOptions, Programs):
    """What every command takes."""

    methods: tuple[Name, ...] = ()
    """Methods to run, any beside each other; none given means all of --variant that the source has the cameras for."""
    variant: Variant | None = None
    """Which methods run where --methods does not say: modern, or paper (exactly as published). Default: modern. On
    first launch the app uses paper until compilation finishes."""
    settings: Annotated[Settings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Settings)

    @property
    def of_source(self) -> SourceOptions:
        """Those that say how the source is opened."""
        return SourceOptions(**{f.name: getattr(self, f.name) for f in fields(SourceOptions)})

    @property
    def config(self) -> Config:
        """The settings of all methods."""
        return config_of(self.settings)


@dataclass(frozen=True, kw_only=True)
class Serve(Options):
    """What the app takes besides."""

    host: str = "127.0.0.1"
    """Address to listen on. Any but the default lets other machines in, over plain HTTP; they need the token in the
    printed address."""
    port: int = 8090
    """Port of the page; where it is taken, the next free one."""
    allow_host: tuple[str, ...] = ()
    """Host names under which a proxy in front of ISPOM is reached."""
    base: str = "/"
    """Path under which a proxy in front of ISPOM offers it, such as /ispom/."""
    browser: bool = True
    """Open the page in a browser."""
    history_mb: int = 200
    """Memory for the exposures of a run that can be stepped back to [MB]. Older ones are kept on disk."""
    root: Path | None = None
    """Folder to which the page's sources are restricted, links followed; without it, any path can be opened there."""
    read_only: bool = False
    """Print a second address, for onlookers: whoever opens that one sees everything and can change nothing."""
    allow_devices: bool = False
    """Let the page open cameras of this machine (camera:0)."""
    allow_network: bool = False
    """Let the page open network streams (http://..., rtsp://...)."""
    beside: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME[:FRAME]=FILE: the trajectory of another program, shown beside the methods; can be given several times.
    TUM, KITTI (a row for each image) and EuRoC files. FRAME, whose poses they are: rig (default), left, right or
    video."""
    beside_alignment: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME=ALIGNMENT: how one of them is aligned to the ground truth, or without it to the first metric method: se3
    (the default), sim3 (needed where its unit is not the metre), scale, first, none."""

    def opener(self, named: str) -> Callable[..., Sequence]:
        """What opens sources in the app, as `opened` does: `named`, from the command line, in any case, others as
        these options allow.

        InputError where the options themselves are not possible.
        """
        if self.root is not None and not is_folder(expanded(self.root)):
            raise InputError(f"--root is {self.root}, which is not a folder: give one that exists")
        root = None if self.root is None else expanded(self.root)
        files = () if self.camera is None else (expanded(self.camera),)
        policy = SourcePolicy(root, self.allow_devices, self.allow_network, files)

        def opened(source: str, options: SourceOptions | None = None) -> Sequence:
            if source in (named, without_secrets(named)):  # the page shows and sends it without its password
                return replace(options or self, camera=self.camera).opened(named)
            return (options or self).opened(source, policy)

        return opened


@dataclass(frozen=True, kw_only=True)
class Demo(Serve):
    """Opens the app on the simulated experiment (sim:city)."""


@dataclass(frozen=True, kw_only=True)
class App(Serve):
    """Opens the app on a source, or on a run or a recording that is over."""

    source: tyro.conf.Positional[str]
    """sim:NAME, the folder of a drive (KITTI, EuRoC, TUM) or of images, a video, a bag, a sequence.yaml, or a live
    camera: camera:0, http://..., rtsp://...; or, for review, a folder that `ispom run` wrote, or a recording
    (FILE.rrd)."""


@dataclass(frozen=True, kw_only=True)
class Learn(Serve):
    """Opens the app with its lessons: predict, run, and see."""

    lesson: tyro.conf.Positional[str] = ""
    """Which to begin: scale, rotation, collapse, bundle, stereo, integration, clock, calibration, outliers, errors,
    table1; or a Markdown file of your own. Without it, choose in the page."""


@dataclass(frozen=True, kw_only=True)
class Run(Options):
    """Runs the methods over a source without a window, and writes trajectories, metrics and a recording."""

    source: tyro.conf.Positional[str]
    """sim:NAME, the folder of a drive (KITTI, EuRoC, TUM) or of images, a video, a bag, a sequence.yaml, or a live
    camera: camera:0, http://..., rtsp://..."""
    out: Path | None = None
    """Folder to write to; without it, a new one below recordings/."""
    frame: Literal["rig", "left", "video"] = "rig"
    """The frame whose poses are written."""
    recording: bool = True
    """Write run.rrd, which any Rerun viewer opens."""
    until: str | None = None
    """Stop after the first exposure where this condition holds, such as 'integrated.error_m > 0.2' or
    'monocular.inliers < 30 and stereo.status == "lost"'. The README lists the names."""


@dataclass(frozen=True, kw_only=True)
class Diff:
    """Finds the first exposure at which two runs differ, and in what: tracks, checks, poses, landmarks. Measured
    times are not compared. The exit code is 0 where the runs are the same, 1 where they differ."""

    run_a: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    run_b: tyro.conf.Positional[Path]
    """Another one; the methods that both ran are compared."""
    tolerance: float = 0.0
    """Ignore differences of numbers up to this: relative above 1, absolute below. Above 0, arrays are not compared bit
    by bit."""
    count: int = 3
    """How many exposures to show: the first, and the next ones at which something else differs for the first time."""
    json: bool = False
    """Print JSON."""


@dataclass(frozen=True, kw_only=True)
class Fork(Programs):
    """Repeats a run up to an exposure, and goes on from there with other settings or methods."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` or `ispom fork` wrote."""
    at: int
    """First exposure with the given settings, counted from 0 as in the page and in steps.csv."""
    methods: tuple[Name, ...] = ()
    """Methods from there on; default: those of the run. A method that did not run before starts there."""
    source: str | None = None
    """Where the run's source is now, if it has been moved."""
    out: Path | None = None
    """Folder to write to; without it, a new one below recordings/."""
    recording: bool = True
    """Write run.rrd, which any Rerun viewer opens."""
    settings: Annotated[Settings, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Settings)
    """Settings that are not given stay as they were in the run."""


@dataclass(frozen=True, kw_only=True)
class Sources(Options):
    """Describes a source without running anything: cameras, calibration, rates, gaps, ground truth."""

    source: tyro.conf.Positional[str]
    """sim:NAME, a path (a data set's folder, images, a video file ...), or a live camera (camera:0, http://...)."""


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Compares trajectories with a reference: ATE, RPE, KITTI's errors, scale and coverage, with their protocol."""

    reference: tyro.conf.Positional[Path]
    """Reference trajectory: a TUM, KITTI or EuRoC file, recognised by its content."""
    estimates: tyro.conf.Positional[tuple[Path, ...]]
    """Trajectories to compare with it."""
    alignment: Alignment = "se3"
    """How an estimate is aligned with the reference. none; first: at the first pose; scale: scale only; se3: rotation
    and translation; sim3: those and scale (needed where the estimate's unit is not the metre)."""
    max_difference_s: float = 0.01
    """Largest time difference of associated poses [s]."""
    times: Path | None = None
    """Times of the rows of KITTI files [s], as KITTI's times.txt."""
    delta: int = 1
    """Distance of the two poses of a relative error (RPE) [poses]."""
    json: Path | None = None
    """Write all numbers and the protocol as JSON to this file."""
    csv: Path | None = None
    """Write a line per estimate to this file."""
    plots: Path | None = None
    """Write plots of trajectories, errors and scale to this folder."""
    plot_format: Literal["png", "svg"] = "png"
    """Format of the plots."""


@dataclass(frozen=True, kw_only=True)
class Report(Programs):
    """Writes an HTML report of one or several runs, a single file that needs no network."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `ispom run` wrote; several are shown side by side."""
    out: Path = Path("report.html")
    """The file to write."""


@dataclass(frozen=True, kw_only=True)
class Export(Programs):
    """Converts a run for other tools: trajectories, point clouds, COLMAP models."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    format: Literal["tum", "kitti", "euroc", "ply", "colmap", "csv"]
    """tum, kitti, euroc: trajectories; ply: cloud and trajectory; colmap: key frames, points and observations, as a
    text model; csv: poses and points with a header."""
    methods: tuple[Name, ...] = ()
    """Methods to export; none given means all of the run."""
    out: Path | None = None
    """Folder to write to; without it, export/FORMAT in the run's."""
    max_error_px: float = 3.0
    """COLMAP: largest reprojection error of an observation that a model keeps [px]."""


@dataclass(frozen=True, kw_only=True)
class Perturb(Programs):
    """Predicts what an error of the calibration does to the trajectories of a run, from what the run saw. Without an
    error: what one step of each would do."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    wrong: Annotated[Perturbation, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Perturbation)
    rerun: bool = False
    """Run again with the wrong calibration, and show that beside the prediction."""
    source: str | None = None
    """Where the run's source is now, if it has been moved."""
    out: Path | None = None
    """Folder for the predicted trajectories (and those of the rerun), the perturbed rig.yaml, and all numbers."""


@dataclass(frozen=True, kw_only=True)
class Repair(Programs):
    """Repairs what a killed run left: completes recordings, writes trajectories and metrics up to where it ended."""

    folder: tyro.conf.Positional[Path]
    """Folder of an incomplete run, or a folder that holds recordings and such folders."""
