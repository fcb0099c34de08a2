"""One URL, one port: our page, viser, the Rerun viewer with its stream, and the recordings."""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable, Hashable, Iterable
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from ...engine.model.corrections import corrected_by
from ...engine.run_folder.run_folder import CORRECTED_RIG
from ...session.people import People, Person
from ...session.registry import modules
from ...session.session import Session
from ...session.sources.folders import run_name
from ..rerun.live import LiveStream
from ..viser.portless import CLIENT, PortlessViser
from . import numbers
from .access import Access
from .connections import Connections
from .files import (
    SECURITY,
    STATIC,
    VISER_SECURITY,
    pictures,
    recordings,
    send_file,
    send_one_of,
    send_script,
)
from .messages import Pane
from .rerun_assets import SCRIPT, WASM, ViewerFiles
from .sockets import COMMAND_BYTES, VISER_BYTES, Talk, opened, serve_viser
from .tape_reader import TapeReader
from .view_values import scripts
from .wakeup import Wakeup

log = logging.getLogger(__name__)
PAGE_FILES = frozenset(path.name for path in STATIC.iterdir())
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class Backends:
    """What is behind the gateway; none of it listens anywhere."""

    session: Session
    live: LiveStream
    viser: PortlessViser
    viewer: Callable[[], ViewerFiles]
    """The Rerun viewer's files; OSError where they are not there."""
    recordings: Path
    """Their folder."""
    show_tabs: Callable[[frozenset[str]], None] = lambda _: None
    """Called with the tabs of viser that anybody has open."""


class Gateway:
    """The aiohttp application. `connections`, set when there is a server for it, hears who has access.

    A feature's addresses are in `features/NAME/routes.py`: `routes(session, may_drive, base)`.
    """

    def __init__(self, backends: Backends, access: Access, cookie: str) -> None:
        """`cookie` is the name under which browsers keep the token."""
        self._to, self._access, self._cookie = backends, access, cookie
        self.connections: Connections | None = None
        self._sockets: set[web.WebSocketResponse] = set()
        self._panes: dict[Hashable, Pane] = {}
        self.app = web.Application(middlewares=[self._guard])
        self.app.cleanup_ctx.append(self._listen)
        self.app.on_shutdown.append(self._close_sockets)
        base = access.base
        self.app.add_routes(
            [
                web.get(base, self._page),
                web.get(f"{base}ws", self._talk),
                web.get(f"{base}web/{{name}}", self._page_file),
                web.get(f"{base}panels/{{name}}", self._panel_file),
                web.get(f"{base}rerun/{{name}}", self._viewer_file),
                web.get(f"{base}recordings/{{name:.+}}", self._recording),
                web.get(f"{base}pictures/{{name:.+}}", self._picture),
                web.get(f"{base}numbers/{{what}}", self._numbers),
                web.get(f"{base}viser", self._viser),
                web.get(f"{base}viser/", self._viser),
            ]
        )
        for module in modules("routes"):
            self.app.add_routes(module.routes(self._to.session, self._may_drive, base))
        if base != "/":
            self.app.router.add_get(base.rstrip("/"), self._to_base)

    async def _listen(self, app: web.Application) -> AsyncIterator[None]:
        """Hears of what happens in other threads, as long as the server runs."""
        self._states, self._grown = Wakeup(), Wakeup()
        self._people = People(self._states.ring)
        self._to.session.changes.add(self._states.ring)
        self._to.live.grown.add(self._grown.ring)
        yield
        self._to.session.changes.remove(self._states.ring)
        self._to.live.grown.remove(self._grown.ring)

    async def _close_sockets(self, app: web.Application) -> None:
        for socket in set(self._sockets):
            await socket.close(code=1001, message=b"the server stopped")

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Nothing is done for whom there is nothing here; a fault of ours costs that answer only, and is logged."""
        self._access.check(request, self._cookie)
        if self.connections is not None:
            self.connections.admit(request)
        try:
            return await handler(request)
        except (web.HTTPException, ConnectionError, asyncio.CancelledError):
            raise
        except Exception as fault:
            log.exception("%s failed", request.path[:80])
            raise web.HTTPInternalServerError(text="Internal error; see ISPOM's terminal.") from fault

    # Files

    async def _to_base(self, request: web.Request) -> web.StreamResponse:
        raise web.HTTPFound(self._access.base + (f"?{request.query_string}" if request.query_string else ""))

    async def _page(self, request: web.Request) -> web.StreamResponse:
        """Our page; a browser that came with a token keeps it, and a name by which its pages are one person's."""
        cookie_values, rest = {}, f"; HttpOnly; SameSite=Strict; Path={self._access.base}"
        if token := request.query.get("token", ""):
            cookie_values[self._cookie] = self._access.stored_token(token)
        if not request.cookies.get(self._person_cookie):
            cookie_values[self._person_cookie] = secrets.token_urlsafe(9)
        cookies = (f"{name}={value}{rest}" for name, value in cookie_values.items())
        return await send_file(request, STATIC / "index.html", SECURITY, cookies)

    @property
    def _person_cookie(self) -> str:
        return f"{self._cookie}-person"

    def _person(self, request: web.Request) -> Person:
        tokens = request.cookies.get(self._cookie, ""), request.query.get("token", "")
        may_drive = any(self._access.may_drive(token) for token in tokens)
        return Person(request.cookies.get(self._person_cookie, "")[:32], may_drive)

    def _may_drive(self, request: web.Request) -> bool:
        return self._person(request).may_drive

    async def _page_file(self, request: web.Request) -> web.StreamResponse:
        return await send_one_of(request, STATIC, PAGE_FILES, SECURITY)

    async def _panel_file(self, request: web.Request) -> web.StreamResponse:
        """The components of a feature."""
        path = scripts().get(request.match_info["name"])
        if path is None:
            raise web.HTTPNotFound
        return await send_file(request, path, SECURITY)

    async def _viewer_file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        if name not in (SCRIPT, WASM):
            raise web.HTTPNotFound
        try:
            viewer = await asyncio.to_thread(self._to.viewer)
        except OSError as fault:
            raise web.HTTPServiceUnavailable(text=str(fault)) from fault
        if name == SCRIPT:
            return send_script(request, viewer.script, SECURITY)
        return await send_file(request, viewer.wasm, SECURITY)

    async def _recording(self, request: web.Request) -> web.StreamResponse:
        return await self._kept(request, recordings, {"Content-Disposition": "attachment"})

    async def _picture(self, request: web.Request) -> web.StreamResponse:
        return await self._kept(request, pictures, {})

    async def _kept(
        self, request: web.Request, names_in: Callable[[Path], Iterable[str]], headers: dict[str, str]
    ) -> web.StreamResponse:
        """One of these files of the recordings folder."""
        folder = self._to.recordings
        names = await asyncio.to_thread(lambda: list(names_in(folder)))
        return await send_one_of(request, folder, names, SECURITY | headers)

    async def _numbers(self, request: web.Request) -> web.StreamResponse:
        """What is known of the frame shown, or of all so far, as a file."""
        session, what = self._to.session, request.match_info["what"]
        state, run = session.state, session.run
        if run is None or state.index < 0 or what not in ("exposure", "run", "rig"):
            raise web.HTTPNotFound
        if state.covers:
            raise web.HTTPForbidden(text="A question of the lesson is open: the numbers are there when it is answered.")
        if what == "rig":
            text = await asyncio.to_thread(corrected_by, run.history, state.index, run.opened.sequence.rig)
        elif what == "exposure":
            text = await asyncio.to_thread(numbers.of_exposure, run.series, state.index)
        else:
            text = await asyncio.to_thread(numbers.over_time, run.series, len(run.series))
        plain = re.sub(r"[^A-Za-z0-9._-]+", "-", run_name(state.source))
        ending = {"exposure": f"-{state.index}.csv", "run": ".csv", "rig": f"-{CORRECTED_RIG}"}[what]
        headers = {"Content-Disposition": f'attachment; filename="{plain}{ending}"', "Cache-Control": "no-store"}
        kind = "application/yaml" if what == "rig" else "text/csv"
        return web.Response(text=text, content_type=kind, headers=SECURITY | headers)

    # Sockets

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        socket = await opened(request, COMMAND_BYTES)
        frames = TapeReader(lambda: self._to.live.tape, self._grown)
        talk = Talk(self._to.session, self._states, frames, self._see, self._people, self._person(request))
        return await self._until_closed(socket, talk.serve(socket))

    async def _viser(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Upgrade", "").lower() != "websocket":
            if not request.path.endswith("/"):  # its addresses are relative
                raise web.HTTPFound("viser/")
            return await send_file(request, CLIENT, VISER_SECURITY)
        offered = request.headers.get("Sec-WebSocket-Protocol", "").split(",")
        socket = await opened(request, VISER_BYTES, tuple(p.strip() for p in offered if p.strip())[:1])
        person = self._person(request)
        served = serve_viser(socket, self._to.viser, lambda message: self._people.passes(person, message))
        return await self._until_closed(socket, served)

    async def _until_closed(self, socket: web.WebSocketResponse, served: Awaitable[None]) -> web.StreamResponse:
        self._sockets.add(socket)
        try:
            await served
        finally:
            self._sockets.discard(socket)
        return socket

    def _see(self, page: Hashable, pane: Pane) -> None:
        self._panes = {other: seen for other, seen in self._panes.items() if other is not page}
        self._panes |= {page: pane} if pane.tab else {}
        self._to.show_tabs(frozenset(seen.tab for seen in self._panes.values()))
