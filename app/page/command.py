"""`ispom demo` and `ispom app`: a source in a session, and the session on a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from platformdirs import user_config_path

from ispom.errors import InputError
from ispom.methods import in_order
from ispom.sequences.address import is_address, is_device
from ispom.types import Sequence

from ..options import App, Serve
from ..rerun_log.live import LiveStream
from ..run import warmup
from ..run.beside.given import Given, given
from ..run.beside.placed import beside_run
from ..run.playback import Builder, truth_from_start
from ..session.session import Session
from ..session.sources.folders import Folders
from ..session.sources.opening import stored_at
from ..session.sources.recent import RecentSources
from .server import Serving, serve

LEAST_HISTORY_MB = 20
"""Some hundred exposures."""


def open_page(command: Serve, builder: Builder) -> int:
    """Serves the page until it is ended, and returns the exit code. InputError for a mistake in what was asked."""
    source = command.source if isinstance(command, App) else "sim:city"
    if command.history_mb < LEAST_HISTORY_MB:
        raise InputError(f"--history-mb is {command.history_mb}, give {LEAST_HISTORY_MB} or more")
    opener, beside = command.opener(source), given(command.beside, command.beside_alignment)
    if beside:
        _check_beside(beside, source, opener, builder)
    variant = command.variant or ("modern" if command.methods else warmup.at_first(command.config))

    def session(live: LiveStream) -> Session:
        return Session(
            opener,
            source,
            Path("recordings"),
            methods=in_order(command.methods) or None,
            variant=variant,
            config=command.config,
            live=live,
            compiling=warmup.start,
            builder=builder,
            history_bytes=1_000_000 * command.history_mb,
            source_options=command.of_source,
            folders=Folders(None if command.root is None else command.root.expanduser()),
            recent=RecentSources(user_config_path("ispom") / "recent.json"),
            beside=beside,
        )

    return serve(
        session,
        Serving(
            host=command.host,
            port=command.port,
            allowed_hosts=command.allow_host,
            base=command.base,
            open_browser=command.browser,
            onlookers=command.read_only,
        ),
    )


def _check_beside(beside: tuple[Given, ...], source: str, opener: Callable[..., Sequence], builder: Builder) -> None:
    """InputError for a trajectory that does not fit the source: before anything is shown."""
    if is_device(source) or is_address(source):
        raise InputError("--beside needs a recording, and this source is live: record it first, and open that")
    stored = stored_at(source, opener, builder)
    sequence = opener(source) if stored is None else stored.playback.sequence
    for number, each in enumerate(beside):
        beside_run(number, each, sequence, truth_from_start(sequence))
