"""Options of the commands that open the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from ispom.errors import InputError
from ispom.io.files import expanded, is_folder
from ispom.sequences.address import without_secrets
from ispom.sequences.policy import SourcePolicy
from ispom.types import Sequence

from ...engine.options import Options, ReadsRuns, SourceOptions


@dataclass(frozen=True, kw_only=True)
class Serve(Options):
    """Further options of the app."""

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
    """Memory for the frames of a run that can be stepped back to [MB]. Older ones are kept on disk."""
    root: Path | None = None
    """Folder to which the page's sources are restricted, links followed; without it, any path can be opened there."""
    read_only: bool = False
    """Print a second address, for onlookers: whoever opens that one sees everything and can change nothing."""
    agents: int | None = None
    """Also serve tools for an agent, as `ispom mcp` does, on this port of 127.0.0.1 (0: any free one), with the token
    of the page. The agent sees this session, and changes nothing in it."""
    allow_devices: bool = False
    """Let the page open cameras of this machine (camera:0)."""
    allow_network: bool = False
    """Let the page open network streams (http://..., rtsp://...)."""
    beside: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """NAME[:FRAME]=FILE: the trajectory of another program, shown with the methods; can be given several times.
    Files of poses of any known program; those without times have a row for each image. FRAME, whose poses they are:
    rig (default), left, right or video."""
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
            if named and source in (named, without_secrets(named)):  # the page shows and sends it without its password
                own = {name: getattr(self, name) for name in ("camera", "sensors", "scale_calibration", "topics")}
                return replace(options or self, **own).opened(named)
            return (options or self).opened(source, policy)

        return opened


@dataclass(frozen=True, kw_only=True)
class Demo(Serve):
    """Opens the app on the simulated experiment (sim:city)."""


@dataclass(frozen=True, kw_only=True)
class App(Serve, ReadsRuns):
    """Opens the app: on its start screen, or on a source, or on a run or a recording that is over."""

    READS: ClassVar[tuple[str, ...]] = ("source",)
    source: tyro.conf.Positional[str] = ""
    """Without one, choose in the page.
    sim:NAME, the folder of a drive (KITTI, EuRoC, TUM) or of images, a video, a bag, a sequence.yaml, or a live
    camera: camera:0, http://..., rtsp://...; or, for review, a folder that `ispom run` wrote, or a recording
    (FILE.rrd)."""
    at: int | None = None
    """Frame at which the page opens, counted from 0. Default: the first one."""


@dataclass(frozen=True, kw_only=True)
class Learn(Serve):
    """Opens the app with its lessons: predict, run, and see."""

    lesson: tyro.conf.Positional[str] = ""
    """Which to begin: scale, rotation, collapse, bundle, stereo, integration, clock, calibration, outliers, errors,
    table1, intensities, view, sensors; or a Markdown file of your own. Without it, choose in the page."""
