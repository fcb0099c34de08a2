"""What one `ispom run` is to do, and what it was forked from."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...engine.conditions.evaluate import Until
from ...engine.playback import Playback, Stage
from ...engine.run_events.table import EventRecorder
from ...engine.run_folder.placements import PlacementLog
from ...engine.run_folder.run_file import RunFile, fork_entry
from ...engine.run_folder.run_folder import RunFolder
from .console import Progress, progress
from .options import Run
from .seen import Seen


@dataclass(frozen=True)
class Origin:
    """What a run was forked from."""

    run: RunFile
    folder: Path
    stages: tuple[Stage, ...]
    """Of its own origins, and the run itself."""

    @property
    def entries(self) -> list[dict[str, Any]]:
        """As the fork's run.yaml has them."""
        runs = [str(entry.get("run", "")) for entry in self.run.forked][: len(self.stages) - 1]
        return [fork_entry(name, stage) for name, stage in zip([*runs, str(self.folder)], self.stages, strict=True)]


@dataclass(frozen=True, eq=False)
class Job:
    """One run: its options, and what changes while it goes on."""

    options: Run
    methods: tuple[str, ...]
    """To be written; `playback` runs those that they ask, too."""
    origin: Origin | None
    playback: Playback
    watch: Until
    folder: RunFolder
    progress: Progress = progress
    """Called at each frame."""
    computes: bool = True
    """Whether the methods compute: CPU time and memory of repeated results would not be theirs."""
    placements: PlacementLog = field(default_factory=PlacementLog)
    events: EventRecorder = field(default_factory=EventRecorder)
    seen: Seen = field(default_factory=Seen)
