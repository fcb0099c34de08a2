"""The run's stream to one page: the frame that it shows."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections.abc import Callable
from contextlib import suppress

from aiohttp import web

from ..rerun.parts import Scene, SceneWriter
from ..rerun.rrd import HEADER
from ..rerun.stored_tape import AnyTape
from .wakeup import Wakeup

HEAD = struct.Struct(">II?3x")
"""Of a message: the serial number, the frame that it brings, and whether that is complete."""
FIRST_S = 2.0
"""Longest wait for a run's first frame to be complete."""


class TapeReader:
    """One page's place on the tape.

    The page is sent the frame that it shows, and nothing more until it has taken that in: then the newest one. A frame
    that comes later, or changes, is sent by itself. A run begins with a text, its name and the id of its recording;
    frames are bytes: HEAD, then an `.rrd` stream.
    """

    def __init__(self, tape: Callable[[], AnyTape | None], grown: Wakeup) -> None:
        self._tape, self._grown = tape, grown
        self._run, self._serial = "", 0
        """What the page had when it came, and the last message that it was sent since."""
        self._is_ready = False
        """Whether the page has a viewer."""
        self._takes_frame = False
        self._writer: SceneWriter | None = None
        self._index = -1
        """The frame that the page shows; -1 for none yet."""
        self._sent = 0
        """The serial number of the last message to this connection."""
        self._shown: tuple[int, bool] | None = None
        """The frame that the page was sent last, and whether that is complete."""
        self._requested = -1
        """The frame whose images were requested last."""
        self._patience_s: float | None = None
        """Until then a run's first frame may become complete."""

    def look_at(self, index: int) -> None:
        """The page shows this frame now."""
        if index != self._index:
            self._index = index
            self._grown.ring()

    def ready(self, run: str, serial: int) -> None:
        """The viewer of the page has this run, has taken in all up to this message, and can take a frame. Void where
        another message is on its way: the page says it again for that one."""
        if not self._is_ready:
            self._is_ready, self._run, self._serial = True, run, serial
        if serial >= self._sent:
            self._takes_frame = True
            self._grown.ring()

    async def serve(self, socket: web.WebSocketResponse) -> None:
        """As long as the page is there."""
        try:
            while True:
                news = self._grown.next()
                if not (self._is_ready and await self._answer(socket)):
                    left_s = None if self._patience_s is None else max(0.0, self._patience_s - time.monotonic())
                    with suppress(TimeoutError):
                        await asyncio.wait_for(news.wait(), left_s or None)
        except ConnectionError:
            pass  # the browser went away
        finally:
            if self._writer is not None:
                self._writer.close()

    async def _answer(self, socket: web.WebSocketResponse) -> bool:
        """Sends what is there; False where there is nothing new."""
        tape = self._tape()
        if tape is None:
            return False
        writer = self._writer
        if writer is None or writer.source is not tape:
            if tape.run == self._run:
                writer = self._follow(tape)
            elif (first := await self._first(tape)) is None:
                return False
            else:
                writer = self._follow(tape)
                self._run, self._takes_frame = tape.run, False
                await socket.send_str(json.dumps({"begins": {"run": tape.run, "recording": tape.recording_id}}))
                await self._deliver(socket, writer, await asyncio.to_thread(tape.opening), first)
                return True
        if self._takes_frame and (scene := await self._changed(tape, writer)) is not None:
            self._takes_frame = False
            await self._deliver(socket, writer, b"", scene)
            return True
        return False

    def _follow(self, tape: AnyTape) -> SceneWriter:
        if self._writer is not None:
            self._writer.close()
        self._writer, self._shown, self._requested = SceneWriter(tape, fresh=self._serial == 0), None, -1
        return self._writer

    async def _first(self, tape: AnyTape) -> Scene | None:
        """A run's first frame, when it is there: what the page shows before stays until then."""
        end = tape.end
        if self._index < 0 or not end or end < min(self._index + 1, tape.expected):
            return None
        scene = await self._scene(tape, min(self._index, end - 1))
        if scene.missing:
            self._patience_s = self._patience_s or time.monotonic() + FIRST_S
            if time.monotonic() < self._patience_s:
                return None
        self._patience_s = None
        return scene if self._tape() is tape else None

    async def _changed(self, tape: AnyTape, writer: SceneWriter) -> Scene | None:
        """The frame that the page asks for, or until it is there the last one; None where the page has that already."""
        end = tape.end
        if not end:
            return None
        scene = await self._scene(tape, min(self._index, end - 1))
        news = self._shown != (scene.index, not scene.missing) or writer.differs(scene)
        return scene if news and self._tape() is tape else None  # else its content is gone

    async def _scene(self, tape: AnyTape, index: int) -> Scene:
        scene = await asyncio.to_thread(tape.scene, index)
        if scene.missing and self._requested != index:
            self._requested = index
            tape.request(index)
        return scene

    async def _deliver(self, socket: web.WebSocketResponse, writer: SceneWriter, opening: bytes, scene: Scene) -> None:
        self._sent = self._serial = self._serial + 1
        content = opening + await asyncio.to_thread(writer.write, scene, self._serial)
        self._shown = scene.index, not scene.missing
        await socket.send_bytes(HEAD.pack(self._serial, *self._shown) + HEADER + content)
