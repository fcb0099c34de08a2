"""Draws over the frames of the shown run what follows the session and not the frame alone."""

from __future__ import annotations

import logging
import time
from threading import Thread

from ...session import commands as do
from ...session.session import Session
from ...views.rerun.live import LiveStream
from .drawings import drawings

log = logging.getLogger(__name__)
PAINT_S = 1 / 20
PLAYING_S = 1.0
"""Interval at which slow parts are drawn while the run plays."""


class StagePainter:
    """Paints in a thread of its own."""

    def __init__(self, session: Session, live: LiveStream) -> None:
        self._session, self._live = session, live
        self._drawn: dict[str, tuple[object, ...]] = {}
        """By drawing: the values that it was made of."""
        self._due_s: dict[str, float] = {}
        self._tape = ""
        self._fault = ""

    def start(self) -> None:
        """Paints until the program ends."""
        Thread(target=self._paint_on, name="stage", daemon=True).start()

    def paint(self) -> None:
        """Brings the drawings up to date with the session."""
        tape, state, run = self._live.tape, self._session.state, self._session.run
        if tape is None or run is None or state.displayed is None:
            return
        if tape.run != self._tape:
            self._tape, self._drawn, self._due_s = tape.run, {}, {}
        is_changed = False
        by_name = {drawing.name: drawing for drawing in drawings(self._session, state, run)}
        for name in self._drawn.keys() - by_name.keys():
            del self._drawn[name]
            is_changed |= tape.overlay.draw(name, ())
        for name, drawing in by_name.items():
            waits = drawing.takes_long and state.playing and time.monotonic() < self._due_s.get(name, 0.0)
            if waits or self._drawn.get(name) == drawing.made_of:
                continue
            self._drawn[name], self._due_s[name] = drawing.made_of, time.monotonic() + PLAYING_S
            index = state.index if drawing.is_of_frame else None
            is_changed |= tape.overlay.draw(name, drawing.entries(), index)
        if is_changed:
            self._live.grown.notify()

    def _paint_on(self) -> None:
        while True:
            time.sleep(PAINT_S)
            try:
                self.paint()
                self._fault = ""
            except Exception as fault:
                text = f"{type(fault).__name__}: {fault}"
                if text != self._fault:  # reported once as long as it stays the same
                    self._fault = text
                    log.exception("painting failed")
                    self._session.post(do.Notify(f"Some drawings could not be updated ({text}); the run continues."))


PAINTER = StagePainter
