"""The setup of a session, from the command line or from a test."""

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
    """Values that stay the same for the whole session. What a person changes later belongs to the run."""

    opener: Callable[..., Sequence]
    """`opener(source)` opens with the options of the command line, `opener(source, options)` with those of the page."""
    source: str
    """The source that is opened first. Empty: the session waits for a command that opens one."""
    recordings: Path
    """The folder of runs and recordings."""
    methods: tuple[str, ...] | None = None
    """Methods to run. None: all for which a source has the cameras."""
    variant: Variant = "modern"
    """Variant of the methods that run if nobody chose any."""
    config: Config = field(default_factory=Config)
    source_options: SourceOptions = field(default_factory=SourceOptions)
    """Those of the command line."""
    autoplay: bool = True
    compiling: Callable[[tuple[str, ...], Config], None] = lambda *_: None
    """Begins to compile for methods and settings that are about to run."""
    builder: Builder = build
    """Makes the estimators."""
    history_bytes: int = MEMORY_BYTES
    """Most memory for the frames of a run."""
    folders: Folders = field(default_factory=Folders)
    """Where the page may look for sources."""
    recent: RecentSources = field(default_factory=lambda: RecentSources(None))
    """Sources that were opened."""
    trajectory_options: tuple[TrajectoryOption, ...] = ()
    """Trajectories of other programs."""
    compare_images: bool = False
    """Whether images of a stored run are compared with those that the run saw before any is given, because an agent
    sees them."""
    extras: tuple[object, ...] = ()
    """Values that features look up by their type."""
    beginnings: Mapping[str, Path] = field(default_factory=dict)
    """By source: the folder of a run over its first frames, which is shown at once."""
