"""How a session is set up: what the command line says, and what a test puts in its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ispom.ensemble import build
from ispom.methods import Config, Variant
from ispom.types import Sequence

from ..engine.external_trajectories.placed import TrajectoryOption
from ..engine.history.history import MEMORY_BYTES
from ..engine.options import SourceOptions
from ..engine.playback import Builder
from .sources.folders import Folders, RecentSources


@dataclass(frozen=True)
class SessionSetup:
    """The same for as long as the session lives: what a person changes later belongs to the run in which it was."""

    opener: Callable[..., Sequence]
    """`opener(source)` opens with the options of the command line, `opener(source, options)` with those of the page."""
    source: str
    """Opened first. Empty: the session waits for the first command that opens one."""
    recordings: Path
    """The folder of runs and recordings."""
    methods: tuple[str, ...] | None = None
    """None: all that a source has the cameras for."""
    variant: Variant = "modern"
    """Of the methods that run where nobody chose any."""
    config: Config = field(default_factory=Config)
    source_options: SourceOptions = field(default_factory=SourceOptions)
    """Those of the command line."""
    autoplay: bool = True
    compiling: Callable[[tuple[str, ...], Config], None] = lambda *_: None
    """Begins to compile what settings need, when they are about to run."""
    builder: Builder = build
    """Makes the estimators."""
    history_bytes: int = MEMORY_BYTES
    """What the frames of a run may take of memory."""
    folders: Folders = field(default_factory=Folders)
    """Where the page may look for sources."""
    recent: RecentSources = field(default_factory=lambda: RecentSources(None))
    """Sources that were opened."""
    trajectory_options: tuple[TrajectoryOption, ...] = ()
    """Trajectories of other programs."""
    compare_images: bool = False
    """Gives no image of a stored run before all were compared with those that it saw: an agent sees them."""
    extras: tuple[object, ...] = ()
    """Values that features look up by their type."""
    beginnings: Mapping[str, Path] = field(default_factory=dict)
    """By source: the folder of a run over its first frames, which is shown at once."""
