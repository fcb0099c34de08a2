"""Starts everything behind the page, serves it on one port, and takes it down again in order."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import os
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from ispom.errors import InputError
from ispom.estimators import Config, Method, build
from ispom.types import Sequence

from ..run.playback import Builder
from ..session.session import Session
from .gateway import Backends, Gateway
from .rerun_assets import viewer_assets

log = logging.getLogger(__name__)
PORTS_TRIED = 20
CLOSE_S = 1.1
"""For the recording to be closed after Ctrl-C."""
EXIT_S = 2.9
"""After this long the process ends, whatever still hangs."""
_TAKEN = {errno.EADDRINUSE, errno.EACCES}


def serve(
    sequence_opener: Callable[[str], Sequence],
    source: str = "sim:city",
    *,
    host: str = "127.0.0.1",
    port: int = 8090,
    open_browser: bool = True,
    methods: tuple[Method, ...] | None = None,
    config: Config | None = None,
    recordings_dir: Path = Path("recordings"),
    autoplay: bool = True,
    compiling: Callable[[Config], None] = lambda _: None,
    builder: Builder = build,
) -> int:
    """Runs the app until SIGINT or SIGTERM, then ends the process with code 0 (in the main thread; else it returns).

    `sequence_opener` opens a source that the person names, now `source` and later what is typed in the page; it runs
    in the worker thread and raises InputError for what cannot be opened. `methods` None means all that the source has
    the cameras for. `compiling` begins to compile what settings need; `builder` makes the estimators. InputError where
    `host` cannot be listened on.
    """
    code = asyncio.run(
        _serve(
            sequence_opener,
            source,
            host,
            port,
            open_browser,
            methods,
            config,
            recordings_dir,
            autoplay,
            compiling,
            builder,
        )
    )
    if threading.current_thread() is threading.main_thread():
        # Viewers' and renderers' threads may hang for seconds at exit, and nothing of theirs is worth waiting for.
        logging.shutdown()
        sys.stdout.flush()
        os._exit(code)
    return code


async def _serve(
    opener: Callable[[str], Sequence],
    source: str,
    host: str,
    port: int,
    open_browser: bool,
    methods: tuple[Method, ...] | None,
    config: Config | None,
    recordings: Path,
    autoplay: bool,
    compiling: Callable[[Config], None],
    builder: Builder,
) -> int:
    listener = _listener(host, port)
    stopped = asyncio.Event()
    _on_signals(stopped)
    live, session, screen = await asyncio.to_thread(
        _start, opener, source, methods, config, recordings, autoplay, compiling, builder
    )
    backends = Backends(screen.port, live, viewer_assets, screen.show_scene)
    runner = web.AppRunner(
        Gateway(session, backends, recordings, {host, socket.gethostname()}).app, access_log=None, shutdown_timeout=0.3
    )
    await runner.setup()
    try:
        await web.SockSite(runner, listener).start()
        url = f"http://{_name(host)}:{listener.getsockname()[1]}/"
        _say(f"ISPOM is at {url}   (Ctrl-C ends it)")
        if open_browser:
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True, name="browser").start()
        await stopped.wait()
    finally:
        _say("closing …")
        if not await asyncio.to_thread(session.close, CLOSE_S):
            _say("the worker was still busy: a recording that was going on ends with what was written so far")
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(runner.cleanup(), 0.7)
    return 0


def _start(opener, source, methods, config, recordings, autoplay, compiling, builder):
    from ..rerun_log.live import LiveStream
    from ..viser_ui.screen import Screen

    live = LiveStream()
    options = {"methods": methods, "config": config, "live": live, "autoplay": autoplay, "compiling": compiling}
    options |= {"builder": builder}
    session = Session(opener, source, recordings, **options)
    session.start()
    screen = Screen(session)
    screen.start()
    return live, session, screen


def _listener(host: str, port: int) -> socket.socket:
    """A socket on the first free port from `port` on (0: on any); says which ones are taken."""
    for candidate in range(port, port + PORTS_TRIED) if port else (0,):
        try:
            family = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM)[0][0]
            return socket.create_server((host, candidate), family=family, backlog=128)
        except OSError as fault:
            if fault.errno not in _TAKEN:
                raise InputError(f"{host} cannot be listened on ({fault.strerror}): give another --host") from fault
            _say(f"port {candidate} is taken, trying the next one")
    raise InputError(f"ports {port} to {port + PORTS_TRIED - 1} are all taken: give another --port")


def _name(host: str) -> str:
    """What a browser on this machine calls the host."""
    everywhere = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}
    return everywhere.get(host, f"[{host}]" if ":" in host else host)


def _on_signals(stopped: asyncio.Event) -> None:
    """SIGINT and SIGTERM end the app in order; a second one, or too long a wait, ends the process at once."""

    def stop() -> None:
        if stopped.is_set():
            os._exit(1)
        stopped.set()
        end = threading.Timer(EXIT_S, os._exit, (0,))
        end.daemon = True
        end.start()

    loop = asyncio.get_running_loop()
    if threading.current_thread() is not threading.main_thread():
        return
    for number in (signal.SIGINT, signal.SIGTERM):
        try:
            loop.add_signal_handler(number, stop)
        except NotImplementedError:  # Windows
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(stop))


def _say(text: str) -> None:
    """For the person at the terminal."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
