"""Options of `ispom mcp`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...engine.options import Options


@dataclass(frozen=True, kw_only=True)
class Mcp(Options):
    """Serves tools for an agent: runs, events, verdicts, checks, conditions, differences and pictures, by the Model
    Context Protocol on standard input and output. Read-only unless --allow-changes is given."""

    sources: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Runs (folders that `ispom run` wrote), recordings (FILE.rrd), or sources as of `ispom app`. The first one is
    opened; the agent may open the others, every run in the folder of --runs, and simulations."""
    runs: Path = Path("recordings")
    """Folder with runs that the agent may list, open and compare."""
    poses: tuple[Path, ...] = ()
    """Files with poses, and folders of such, that the agent may judge and evaluate, besides those in the folder of
    --runs and in the folders of the sources."""
    allow_changes: bool = False
    """Let the agent fork runs. Without it, such tools are refused."""
    http: int | None = None
    """Serve streamable HTTP on this port of 127.0.0.1 instead (0: any free one). Each request needs the token in the
    printed address."""
    log: Path | None = None
    """Append a line for each call to this file. Without it, they go to standard error."""
    history_mb: int = 200
    """Memory for the frames of a run that can be looked back at [MB]. Older ones are kept on disk."""
