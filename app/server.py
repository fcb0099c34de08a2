"""Starts everything behind the page, serves it on one port, and takes it down again in order."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from ispom.errors import InputError
from ispom.estimators import Config, Method
from ispom.types import Sequence

from .gateway import Backends, Gateway
from .rerun_assets import viewer_assets
from .session import Session

log = logging.getLogger(__name__)
PORTS_TRIED = 20
CLOSE_S = 2.0
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
) -> int:
    """Runs the app until SIGINT or SIGTERM. Returns the exit code: 0 after either, 2 where no port could be had.

    `sequence_opener` opens a source that the person names, now `source` and later what is typed in the page; it runs
    in the worker thread and raises InputError for what cannot be opened. `methods` None means all that the source has
    the cameras for. InputError where `host` cannot be listened on.
    """
    return asyncio.run(
        _serve(sequence_opener, source, host, port, open_browser, methods, config, recordings_dir, autoplay)
    )


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
) -> int:
    stopped = asyncio.Event()
    _on_signals(stopped)
    live, session, screen = await asyncio.to_thread(_start, opener, source, methods, config, recordings, autoplay)
    gateway = Gateway(session, Backends(screen.port, live.port, viewer_assets, screen.show_scene), recordings, {host})
    runner = web.AppRunner(gateway.app, access_log=None, shutdown_timeout=0.3)
    await runner.setup()
    try:
        url = await _listen(runner, host, port)
        _say(f"ISPOM is at {url}   (Ctrl-C ends it)")
        if open_browser:
            await asyncio.to_thread(webbrowser.open, url)
        await stopped.wait()
    finally:
        _say("closing …")
        if not await asyncio.to_thread(session.close, CLOSE_S):
            _say("the worker is still busy: the recording has what was written so far")
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(runner.cleanup(), 0.7)
    return 0


def _start(opener, source, methods, config, recordings, autoplay):
    from .screen import Screen
    from .streams import LiveStream

    live = LiveStream()
    session = Session(opener, source, recordings, methods=methods, config=config, live=live, autoplay=autoplay)
    session.start()
    screen = Screen(session, live)
    screen.start()
    return live, session, screen


async def _listen(runner: web.AppRunner, host: str, port: int) -> str:
    """Listens on the first free port from `port` on, and says where."""
    for candidate in range(port, port + PORTS_TRIED) if port else (0,):
        try:
            site = web.TCPSite(runner, host, candidate)
            await site.start()
        except OSError as fault:
            if fault.errno in _TAKEN:
                _say(f"port {candidate} is taken, trying the next one")
                continue
            raise InputError(f"{host} cannot be listened on ({fault.strerror}): give another --host") from fault
        bound = site._server.sockets[0].getsockname()[1]  # type: ignore[union-attr]
        return f"http://{'127.0.0.1' if host in ('0.0.0.0', '::') else host}:{bound}/"
    raise InputError(f"ports {port} to {port + PORTS_TRIED - 1} are all taken: give another --port")


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
