"""Starts everything behind the page, serves it on one port, and takes it down again in order."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Protocol

from ...session.registry import modules
from ...session.session import Session
from ..rerun.live import LiveStream
from ..viser.screen import Screen
from .access import LOOPBACK, Access, checked_base, checked_host
from .connections import Connections, listener, runner_of
from .gateway import Backends, Gateway
from .rerun_assets import viewer_files

CLOSE_S = 1.1
"""For the recording to be closed after Ctrl-C."""
EXIT_S = 2.9
"""After this long the process ends, whatever still hangs."""


class Beside(Protocol):
    """What is served beside the page."""

    def end(self) -> None:
        """Nothing more is answered, soon."""
        ...


@dataclass(frozen=True, kw_only=True)
class Serving:
    """Where the page is, and who may come. InputError for what is no host, port or path."""

    host: str = "127.0.0.1"
    port: int = 8090
    """The first that is tried; 0 for any."""
    allowed_hosts: tuple[str, ...] = ()
    """Names of a proxy in front."""
    base: str = "/"
    open_browser: bool = True
    onlookers: bool = False
    """Whether there is an address for people who may only look."""
    beside: Callable[[Session, Access], Beside] | None = None
    """Starts what is served beside the page to whom the page lets in; may take a moment."""
    mode: str = "debug"
    """In which the page opens: debug, compare or learn."""
    at: int | None = None
    """The frame that it shows first; None: as the session says."""

    def access(self) -> Access:
        trusted = frozenset(checked_host(name) for name in self.allowed_hosts)
        own = {self.host.lower(), socket.gethostname().lower()}
        token = secrets.token_urlsafe(24) if self.onlookers else None
        return Access(frozenset(own) | trusted, trusted, checked_base(self.base), onlookers=token)

    @property
    def fragment(self) -> str:
        """What of the page's address says how it opens: `#at=240`; empty where nothing does."""
        parts = [f"at={self.at}"] if self.at is not None else []
        parts += [f"mode={self.mode}"] if self.mode != "debug" else []
        return f"#{'&'.join(parts)}" if parts else ""

    @property
    def lets_others_in(self) -> bool:
        """Whether other machines reach it."""
        try:
            return not ip_address(self.host).is_loopback
        except ValueError:
            return self.host.lower() not in LOOPBACK


def serve(make_session: Callable[[LiveStream], Session], serving: Serving) -> int:
    """Runs the app until SIGINT or SIGTERM, then ends the process with code 0 (in the main thread; else it returns).

    `make_session` gives the session that feeds the live stream, not started yet. InputError where it cannot be served
    as asked.
    """
    code = asyncio.run(_serve(make_session, serving))
    if threading.current_thread() is threading.main_thread():
        # Viewers' and renderers' threads may hang for seconds at exit, and nothing of theirs is worth waiting for.
        logging.shutdown()
        sys.stdout.flush()
        os._exit(code)
    return code


async def _serve(make_session: Callable[[LiveStream], Session], serving: Serving) -> int:
    access = serving.access()
    listening = listener(serving.host, serving.port, _print)
    port = listening.getsockname()[1]
    stopped = asyncio.Event()
    _on_signals(stopped)
    backends = await asyncio.to_thread(_start, make_session)
    gateway = Gateway(backends, access, f"ispom-{port}")
    runner = runner_of(gateway.app)
    await runner.setup()
    gateway.connections = Connections(runner)
    beside = None
    try:
        server = await asyncio.get_running_loop().create_server(gateway.connections, sock=listening, backlog=128)
        address = f"http://{_name(serving.host)}:{port}{access.base}?token="
        shown = serving.fragment
        _print(f"ISPOM is at {address}{access.token}{shown}   (Ctrl-C ends it)")
        if access.onlookers is not None:
            _print(f"Onlookers see it, and change nothing, at {address}{access.onlookers}")
        if serving.beside is not None:
            beside = await asyncio.to_thread(serving.beside, backends.session, access)
        if serving.lets_others_in:
            _print("Warning: this is plain HTTP: who listens on the network can read the token and all that is shown.")
            _print(f"         Safer: ssh -L {port}:127.0.0.1:{port} HOST without --host, or a proxy with TLS in front.")
        if serving.open_browser:
            found = address + access.ticket.text + shown
            threading.Thread(target=webbrowser.open, args=(found,), daemon=True, name="browser").start()
        await stopped.wait()
        server.close()
    finally:
        _print("closing …")
        if beside is not None:
            beside.end()
        await asyncio.to_thread(backends.session.close, CLOSE_S)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(runner.cleanup(), 0.7)
    return 0


def _start(make_session: Callable[[LiveStream], Session]) -> Backends:
    live = LiveStream()
    session = make_session(live)
    session.start()
    screen = Screen(session)
    screen.start()
    for module in modules("painter"):
        module.PAINTER(session, live).start()
    return Backends(session, live, screen.viser, viewer_files, session.recordings_dir, screen.show_tabs)


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


def _print(text: str) -> None:
    """For the person at the terminal."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
