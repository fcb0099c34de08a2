"""One URL, one port: our page, viser, the Rerun viewer with its stream, and the recordings, for this host alone."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

from aiohttp import ClientError, ClientSession, ClientTimeout, WSMsgType, web

from ..rerun_log.live import LiveStream
from ..session.session import Session
from .feed import Feed
from .messages import Pane, command_of, message_of
from .wakeup import Wakeup

log = logging.getLogger(__name__)
HEARTBEAT_S = 20.0
MESSAGE_BYTES = 1 << 20
PAGE = Path(__file__).parent / "web"
LOOPBACK = {"localhost", "127.0.0.1", "::1"}
REFRESH_S, PLAYING_S = 0.03, 0.1
"""How often pages hear of a new state; and while it plays, where every one is a new picture of the page."""
_HOP = {"connection", "keep-alive", "transfer-encoding", "upgrade", "host", "content-length", "te", "trailer"}
SECURITY = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' blob: data:; img-src 'self' blob: data:; "
    "font-src 'self' data:; worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
VISER_SECURITY = SECURITY | {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; object-src 'none'; "
    "base-uri 'none'; frame-ancestors 'self'"
}


@dataclass(frozen=True)
class Backends:
    """What is behind the gateway."""

    viser_port: int
    live: LiveStream
    assets: Callable[[], Path]
    """The folder of the Rerun viewer's files; may take seconds the first time."""
    show_scene: Callable[[bool], None] = lambda _: None
    """NoticeAdded whether anybody has the pane wide enough to see viser's scene: drawing it for nobody costs time."""


class Gateway:
    """The aiohttp application. `hosts` are the names by which it may be called, besides those of the loopback."""

    def __init__(self, session: Session, backends: Backends, recordings: Path, hosts: set[str]) -> None:
        self._session, self._to, self._recordings = session, backends, recordings
        self._hosts = LOOPBACK | hosts
        self._assets: asyncio.Task[Path] | None = None
        self._sockets: set[web.WebSocketResponse] = set()
        self._wide: set[web.WebSocketResponse] = set()
        self.app = web.Application(middlewares=[self._only_ours])
        self.app.cleanup_ctx.append(self._client)
        self.app.on_shutdown.append(self._say_goodbye)
        self.app.add_routes(
            [
                web.get("/", self._page),
                web.get("/ws", self._talk),
                web.get("/web/{name}", self._page_file),
                web.get("/viewer/{name}", self._viewer_file),
                web.get("/recordings/{name:.+}", self._recording),
                web.get("/viser{rest:(/.*)?}", self._viser),
                web.get("/live", self._live),
            ]
        )

    async def _client(self, app: web.Application):
        self._http = ClientSession(auto_decompress=False, timeout=ClientTimeout(total=None, connect=10))
        self._assets = asyncio.create_task(asyncio.to_thread(self._to.assets))
        self._grown = Wakeup()
        self._to.live.grown.add(self._grown.ring)
        yield
        self._to.live.grown.remove(self._grown.ring)
        self._assets.cancel()
        await self._http.close()

    async def _say_goodbye(self, app: web.Application) -> None:
        for socket in set(self._sockets):
            await socket.close(code=1001, message=b"the server stopped")

    @web.middleware
    async def _only_ours(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Refuses other sites' pages: a foreign name for this host (DNS rebinding), or a foreign origin."""
        name = urlsplit(f"//{request.host}").hostname or ""
        origin = request.headers.get("Origin")
        if not (name in self._hosts or _is_address(name)) or (
            origin is not None and urlsplit(origin).netloc != request.host
        ):
            raise web.HTTPForbidden(text=f"ISPOM answers as {', '.join(sorted(self._hosts))} only.")
        return await handler(request)

    # Our page

    async def _page(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(PAGE / "index.html", headers=SECURITY | {"Cache-Control": "no-cache"})

    async def _page_file(self, request: web.Request) -> web.StreamResponse:
        return _file(PAGE, request.match_info["name"])

    async def _viewer_file(self, request: web.Request) -> web.StreamResponse:
        assert self._assets is not None
        try:
            folder = await asyncio.shield(self._assets)
        except OSError as fault:
            raise web.HTTPServiceUnavailable(text=f"The Rerun viewer could not be unpacked: {fault}") from fault
        response = _file(folder, request.match_info["name"])
        response.headers["Cache-Control"] = "max-age=31536000, immutable"
        return response

    async def _recording(self, request: web.Request) -> web.StreamResponse:
        response = _file(self._recordings, request.match_info["name"])
        response.headers["Content-Disposition"] = "attachment"
        return response

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        """States out, commands in."""
        socket = web.WebSocketResponse(heartbeat=20)
        await socket.prepare(request)
        self._sockets.add(socket)
        sender = asyncio.create_task(self._send_states(socket))
        try:
            async for message in socket:
                heard = command_of(message.data) if message.type is WSMsgType.TEXT else None
                if isinstance(heard, Pane):
                    self._see(socket, heard.wide)
                elif heard is not None:
                    self._session.post(heard)
        finally:
            sender.cancel()
            self._sockets.discard(socket)
            self._see(socket, False)
        return socket

    def _see(self, socket: web.WebSocketResponse, wide: bool) -> None:
        (self._wide.add if wide else self._wide.discard)(socket)
        self._to.show_scene(bool(self._wide))

    async def _send_states(self, socket: web.WebSocketResponse) -> None:
        shown = None
        try:
            while not socket.closed:
                if (state := self._session.state) is not shown:
                    shown = state
                    await socket.send_str(json.dumps(message_of(state)))
                await asyncio.sleep(PLAYING_S if state.playing else REFRESH_S)
        except ConnectionError:
            pass  # the browser went away

    # What stands behind

    async def _viser(self, request: web.Request) -> web.StreamResponse:
        query = f"?{request.query_string}" if request.query_string else ""
        target = f"//127.0.0.1:{self._to.viser_port}{request.match_info['rest'] or '/'}{query}"
        if request.headers.get("Upgrade", "").lower() == "websocket":
            return await self._relay(request, f"ws:{target}")
        return await self._forward(request, f"http:{target}", VISER_SECURITY)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """The run's stream out; a page's requests for more of it in."""
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=MESSAGE_BYTES)
        await socket.prepare(request)
        self._sockets.add(socket)
        try:
            place = request.query.get("run", ""), int(request.query.get("next", 0))
            await Feed(lambda: self._to.live.tape, self._grown, *place).serve(socket)
        finally:
            self._sockets.discard(socket)
        return socket

    async def _forward(self, request: web.Request, url: str, extra: dict[str, str]) -> web.StreamResponse:
        """Passes a request and its answer on, byte by byte; a reader that goes away ends it quietly."""
        headers = {k: v for k, v in request.headers.items() if k.lower() not in _HOP | {"origin"}}
        try:
            async with self._http.request(request.method, url, headers=headers, data=await request.read()) as found:
                kept = {k: v for k, v in found.headers.items() if k.lower() not in _HOP | {"date", "server"}}
                response = web.StreamResponse(status=found.status, headers=kept | extra)
                await response.prepare(request)
                async for chunk in found.content.iter_any():
                    await response.write(chunk)
                await response.write_eof()
                return response
        except (ClientError, ConnectionError) as fault:
            log.debug("%s ended: %s", url, fault)
            raise web.HTTPBadGateway(text="That part of ISPOM does not answer.") from fault

    async def _relay(self, request: web.Request, url: str) -> web.StreamResponse:
        """A WebSocket, both ways."""
        protocols = [p.strip() for p in request.headers.get("Sec-WebSocket-Protocol", "").split(",") if p.strip()]
        try:
            async with self._http.ws_connect(url, protocols=protocols, max_msg_size=0) as there:
                here = web.WebSocketResponse(protocols=protocols, max_msg_size=0)
                await here.prepare(request)
                self._sockets.add(here)
                both = [asyncio.create_task(_pump(here, there)), asyncio.create_task(_pump(there, here))]
                try:
                    await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for task in both:
                        task.cancel()
                    self._sockets.discard(here)
                    await here.close(code=there.close_code or 1001)
                return here
        except ClientError as fault:
            raise web.HTTPBadGateway(text="That part of ISPOM does not answer.") from fault


async def _pump(source, sink) -> None:
    try:
        async for message in source:
            if message.type is WSMsgType.BINARY:
                await sink.send_bytes(message.data)
            elif message.type is WSMsgType.TEXT:
                await sink.send_str(message.data)
    except ConnectionError:
        pass  # one of the two went away; the other one follows


def _is_address(name: str) -> bool:
    """Whether it is a numeric address: nobody can make those point elsewhere."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def _file(folder: Path, name: str) -> web.FileResponse:
    """A file in the folder; 404 for anything that is not."""
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()) or not path.is_file():
        raise web.HTTPNotFound
    return web.FileResponse(path, headers=SECURITY | {"Cache-Control": "no-cache"})
