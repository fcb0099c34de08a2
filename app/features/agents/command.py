"""`ispom mcp`: a session without a page, and a server for an agent over it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import confined, exists, expanded, is_folder
from ispom.io.whole import append_to_file
from ispom.methods import choices
from ispom.sequences.policy import SourcePolicy
from ispom.sequences.recorded_sensors import AUTO, NONE
from ispom.types import Sequence

from ...engine import warmup
from ...engine.options import SourceOptions
from ...engine.playback import Builder, builder_within
from ...session.review.stored import place_of
from ...session.session import Session
from ...session.setup import SessionSetup
from ...session.sources.folders import Folders
from .agent_session import SIMULATION, AgentSession
from .options import Mcp
from .required import require_port, require_sdk

CLOSE_S = 2.0
"""For the session to end after the agent has gone."""
LEAST_HISTORY_MB = 20
"""Some hundred frames."""


def serve(options: Mcp, builder: Builder) -> int:
    """Serves an agent until it goes, and returns the exit code. InputError for a mistake in the options."""
    require_sdk("`ispom mcp`")
    if options.history_mb < LEAST_HISTORY_MB:
        raise InputError(f"--history-mb is {options.history_mb}: give {LEAST_HISTORY_MB} or more")
    require_port("--http", options.http)
    with _log(options.log) as log, agent_session(options, builder) as agents:
        if options.sources:
            agents.open(options.sources[0])
        from .server import AgentServer  # brings the SDK

        server = AgentServer(agents, log)
        if options.http is None:
            asyncio.run(server.run_stdio_async())
        else:
            from .http import serve_http

            asyncio.run(serve_http(server, options.http))
    return 0


@contextmanager
def agent_session(options: Mcp, builder: Builder) -> Iterator[AgentSession]:
    """A session without viewers, which is closed at the end. Nothing is open in it yet."""
    runs = options.runs.expanduser()
    if options.runs != Mcp.runs and not is_folder(expanded(options.runs)):
        raise InputError(f"--runs is {options.runs}, which is no folder: give one that exists")
    for path in options.poses:
        if not exists(expanded(path)):
            raise InputError(f"--poses names {path}, which is missing: give files and folders that exist")
    session = Session(
        SessionSetup(
            _opener(options),
            "",
            runs,
            methods=choices(options.methods) or None,
            variant=options.variant or "modern",
            config=options.config,
            compiling=warmup.start,
            builder=builder_within((*_named(options), expanded(runs)), options.config, builder),
            history_bytes=1_000_000 * options.history_mb,
            source_options=options.of_source,
            folders=Folders(),
            compare_images=True,
            autoplay=False,
        )
    )
    session.start()
    try:
        yield AgentSession(session, options.sources, runs, poses=options.poses, allow_changes=options.allow_changes)
    finally:
        session.close(CLOSE_S)


def _opener(options: Mcp) -> Callable[..., Sequence]:
    """Opens what the command line names, and of what that names itself (a sequence.yaml: videos) only files beside it
    or named, too; the source of a stored run, where that is a file; and simulations whose files are in the folder of
    runs."""
    stored, simulated = (SourcePolicy(root, devices=False, network=False) for root in (None, expanded(options.runs)))

    named = _named(options)

    def opened(source: str, of_source: SourceOptions | None = None) -> Sequence:
        if source in options.sources:
            with confined(named or (expanded(options.runs),)):
                return options.opened(source)
        policy = simulated if source.startswith(SIMULATION) else stored
        return (of_source or options).opened(source, policy)

    return opened


def _named(options: Mcp) -> tuple[Path, ...]:
    """The folders of the files that the command line names."""
    files = (
        *options.sources,
        *(str(path) for path in (options.camera, options.sensors) if path not in (None, AUTO, NONE)),
    )
    return tuple(place_of(expanded(file)) for file in files if not file.startswith(SIMULATION))


@contextmanager
def _log(path: Path | None) -> Iterator[Callable[[str], None]]:
    """Writes lines to a file, or else to standard error; never to standard output, which the protocol has."""
    if path is None:
        yield lambda text: print(text, file=sys.stderr, flush=True)  # noqa: T201
        return
    with append_to_file(path.expanduser()) as file:

        def write(text: str) -> None:
            file.write(f"{text}\n".encode())

        yield write
