"""`ispom demo`, `ispom app` and `ispom learn`: a source in a session, and the session on a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from platformdirs import user_config_path, user_state_path

from ispom.errors import InputError, is_text
from ispom.io.files import expanded
from ispom.methods import choices, members
from ispom.sequences.address import is_address, is_device
from ispom.types import Sequence

from ...engine import warmup
from ...engine.external_trajectories.placed import TrajectoryOption, external_trajectory, read_options
from ...engine.playback import Builder, builder_within, truth_from_start
from ...session.session import Session
from ...session.setup import SessionSetup
from ...session.sources.folders import Folders, RecentSources
from ...session.sources.opening import stored_at
from ...views.rerun.live import LiveStream
from ...views.web.access import Access
from ...views.web.server import Beside, Serving, serve
from ..agents.required import require_port, require_sdk
from ..lessons.commands import Learn as Begin
from ..lessons.lesson import Lesson
from ..lessons.library import Library, own_lesson
from .options import App, Learn, Serve

DEMO = "sim:city"
RECORDED = Path(__file__).parent / "demo"
"""A run of the default methods over the first frames of it, which python -m tests.app.demo_run makes."""
LEAST_HISTORY_MB = 20
"""Some hundred frames."""


def open_page(command: Serve, builder: Builder) -> int:
    """Serves the page until it is ended, and returns the exit code. Raises InputError for a mistake in the options."""
    library, begun = _lessons(command)
    source = command.source if isinstance(command, App) else "" if isinstance(command, Learn) else DEMO
    if not is_text(source):
        raise InputError(f"{source} is not UTF-8, which no page can show: rename it, or open a link to it")
    if command.history_mb < LEAST_HISTORY_MB:
        raise InputError(f"--history-mb is {command.history_mb}, give {LEAST_HISTORY_MB} or more")
    if isinstance(command, App) and command.at is not None and (command.at < 0 or not source):
        raise InputError(f"--at is {command.at}: give a source, and a frame of it, counted from 0")
    if command.agents is not None:
        require_sdk("--agents")
        require_port("--agents", command.agents)
    opener, trajectories = command.opener(source), read_options(command.beside, command.beside_alignment)
    if trajectories and not source:
        raise InputError("--beside needs a source to be compared with: give one")
    if trajectories:
        _check_external(trajectories, source, opener, builder)
    needed = members(command.methods) or (() if command.variant == "paper" else warmup.DEFAULT)
    warmup.start(needed, command.config, gentle=source == DEMO)

    places = None if command.root is None else (expanded(command.root),)

    def session(live: LiveStream) -> Session:
        found = Session(
            SessionSetup(
                opener,
                source,
                Path("recordings"),
                methods=choices(command.methods) or None,
                variant=command.variant or "modern",
                config=command.config,
                compiling=warmup.start,
                builder=builder_within(places, command.config, builder),
                history_bytes=1_000_000 * command.history_mb,
                source_options=command.of_source,
                folders=Folders(None if command.root is None else command.root.expanduser()),
                recent=RecentSources(user_config_path("ispom") / "recent.json"),
                trajectory_options=trajectories,
                compare_images=command.agents is not None,
                extras=(library,),
                autoplay=not isinstance(command, Learn),
                beginnings={DEMO: RECORDED},
            ),
            live,
        )
        if begun is not None:
            found.post(Begin(begun.name))
        return found

    return serve(
        session,
        Serving(
            host=command.host,
            port=command.port,
            allowed_hosts=command.allow_host,
            base=command.base,
            open_browser=command.browser,
            onlookers=command.read_only,
            beside=None if command.agents is None else _agents(command.agents),
            mode="learn" if isinstance(command, Learn) else "debug",
            at=command.at if isinstance(command, App) else None,
        ),
    )


def _agents(port: int) -> Callable[[Session, Access], Beside]:
    """What serves the tools for agents at this port, 0 for any."""
    from ..agents.http import serve_beside_page  # brings the SDK of an extra

    return lambda session, access: serve_beside_page(session, port, access)


def _lessons(command: Serve) -> tuple[Library, Lesson | None]:
    """What can be learned, and the lesson that is begun. InputError for one that is none."""
    progress = user_state_path("ispom") / "lessons.json"
    if not isinstance(command, Learn) or not command.lesson:
        return Library(progress=progress), None
    own = own_lesson(command.lesson)
    library = Library(own, progress)
    return library, own or library.lesson(command.lesson)


def _check_external(
    options: tuple[TrajectoryOption, ...], source: str, opener: Callable[..., Sequence], builder: Builder
) -> None:
    """InputError for a trajectory that does not fit the source: before anything is shown."""
    if is_device(source) or is_address(source):
        raise InputError("--beside needs a recording, and this source is live: record it first, and open that")
    stored = stored_at(source, opener, builder)
    sequence = opener(source) if stored is None else stored.playback.sequence
    for number, each in enumerate(options):
        external_trajectory(number, each, sequence, truth_from_start(sequence))
