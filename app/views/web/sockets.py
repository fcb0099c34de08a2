"""What the page's WebSockets say: states and frames out, commands in; and viser's messages."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from contextlib import suppress

from aiohttp import WSCloseCode, WSMsgType, web

from ispom.errors import InputError

from ...session.commands import Command
from ...session.people import People, Person
from ...session.session import Session
from ..viser.portless import PortlessViser, understood
from .messages import LookAt, PageMessage, Pane, Ready, command_of, keys, message_of, own_view
from .news import Look, features_news
from .own_place import OwnPlace
from .tape_reader import TapeReader
from .time_axis import AxisNews
from .view_values import ViewNews
from .wakeup import Wakeup

HEARTBEAT_S = 20.0
"""A page that does not answer within half of it is gone, and one that does not read as well."""
COMMAND_BYTES = 64 << 10
VISER_BYTES = 4 << 20
"""Longest messages of a page."""
COMMANDS_PER_S = 200
"""A page that sends more is closed; a key held down repeats 30 times."""
REFRESH_S, PLAYING_S = 0.03, 0.1
"""Least time between two states for a page; and while it plays, where every one is a new picture of the page."""


async def opened(request: web.Request, most_bytes: int, protocols: tuple[str, ...] = ()) -> web.WebSocketResponse:
    """The request as a WebSocket, without compression: a short message could hide a long one."""
    socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=most_bytes, compress=False, protocols=protocols)
    await socket.prepare(request)
    return socket


class Talk:
    """States and frames out, commands in: one page's."""

    def __init__(
        self,
        session: Session,
        news: Wakeup,
        frames: TapeReader,
        see: Callable[[Talk, Pane], None],
        people: People,
        person: Person,
    ) -> None:
        """`see` gets what of viser this page of `person` shows."""
        self.session, self.people, self.person = session, people, person
        self._news, self._frames, self._see = news, frames, see
        self._own = OwnPlace()
        self._refused: tuple[int, str] = (0, "")
        """How many commands of this page were refused, and why the last one was."""

    async def serve(self, socket: web.WebSocketResponse) -> None:
        """Until the page goes away."""
        self.people.join(self.person)
        sending = [asyncio.create_task(each) for each in (self._send(socket), self._frames.serve(socket))]
        second, count = 0, 0
        try:
            async for message in socket:
                second, count = (now, count + 1) if (now := int(time.monotonic())) == second else (now, 1)
                if count > COMMANDS_PER_S:
                    await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many messages")
                elif message.type is WSMsgType.TEXT:
                    self._obey(command_of(message.data))
        finally:
            for each in sending:
                each.cancel()
            self.see(Pane())
            self.people.leave(self.person)

    def _obey(self, heard: Command | PageMessage | None) -> None:
        if isinstance(heard, PageMessage):
            heard.heard(self)
        elif heard is not None and self.people.drives(self.person):
            self.session.post(heard)
        elif heard is not None:
            self._look(heard)

    def see(self, pane: Pane) -> None:
        """The page has its left pane so."""
        self._see(self, pane)

    def look_at(self, place: LookAt) -> None:
        """The page is at a place of its own, if it does not control the session."""
        if not self.people.seen_by(self.person)["driving"]:
            self._own.look_at(place, self.session.run)
            self._frames.look_at(self._own.shown(self.session.state).index)
            self.ring()

    def follow(self) -> None:
        """The page shows what the session shows, and nothing of its own."""
        self._own.follow()
        self.ring()

    def ready(self, message: Ready) -> None:
        """The viewer of the page can take a frame."""
        self._frames.ready(message.run, message.serial)

    def ring(self) -> None:
        """All pages look at what there is to show now."""
        self._news.ring()

    def _look(self, command: Command) -> None:
        """What somebody asks for who does not control the session: they may look at all that is there."""
        try:
            if not self._own.obey(command, self.session.state, self.session.run):
                raise InputError(self.people.refusal(self.person))
        except InputError as reason:
            self._refused = self._refused[0] + 1, str(reason)
        self._news.ring()

    async def _send(self, socket: web.WebSocketResponse) -> None:
        shown, listed, parts = (), keys(), [AxisNews(), ViewNews(), *features_news()]
        own = self._own
        with suppress(ConnectionError):  # the browser went away
            while True:
                news = self._news.next()
                state, run, seen = self.session.state, self.session.run, self.people.seen_by(self.person)
                if seen["driving"]:
                    own.follow()
                local = own.shown(state)
                look = Look(self.session, self.person.key, state, local, run)
                grown = {name: value for part in parts for name, value in part.of(look).items()}
                now = (state, own.version, seen, self._refused)
                if now != shown or grown:
                    shown = now
                    message = message_of(state) | {"keys": listed, "people": seen}
                    message |= {"looking": own.index, "own": own_view(local, state), "refused": self._refused}
                    message |= grown
                    listed = None
                    await socket.send_str(json.dumps(message))
                    self._frames.look_at(local.index)
                    await asyncio.sleep(PLAYING_S if local.playing else REFRESH_S)
                else:
                    await news.wait()


async def serve_viser(socket: web.WebSocketResponse, viser: PortlessViser, passes: Callable[[bytes], bool]) -> None:
    """A page's connection to viser, until one of the two ends it; `passes` says which of its messages get there."""
    line = viser.connect(socket.ws_protocol or "", socket.send_bytes)
    closing = asyncio.create_task(_close_after(line.served, socket))
    try:
        async for message in socket:
            if message.type is not WSMsgType.BINARY:
                continue
            if not understood(message.data):
                await socket.close(code=WSCloseCode.INVALID_TEXT, message=b"this is no message of viser's page")
            elif passes(message.data):
                await line.put(message.data)
    finally:
        line.hang_up()
        closing.cancel()


async def _close_after(served: asyncio.Future[None], socket: web.WebSocketResponse) -> None:
    await asyncio.wait({served})
    failed = not served.cancelled() and served.exception() is not None
    await socket.close(code=WSCloseCode.INVALID_TEXT if failed else WSCloseCode.OK)
