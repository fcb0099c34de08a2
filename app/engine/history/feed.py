"""The events of one run for somebody who draws or writes them at their own pace: nobody waits for them, and what they
have not taken yet is not kept for them, but read from the history."""

from __future__ import annotations

from collections import deque
from threading import Condition

from ispom.errors import UnreadableImage
from ispom.types import Measurement

from ..events import Event, Finished, Opened, Pictured, Stepped, blank
from .history import History

IMAGES_WAITING = 30
"""Frames whose images wait in memory: a second of video."""
PEOPLE = 8
"""Viewers whose frames get their images, where all look at others."""


class Feed:
    """One run, from its first frame on. `offer`, `finish` and `close` never wait; `take` is for one other thread."""

    def __init__(self, opened: Opened, history: History, *, rereads: bool) -> None:
        """`history` is that of this run. `rereads`: images that did not wait are read from the sequence again;
        otherwise the frame comes without, and is counted in `dropped`."""
        self.opened, self.history = opened, history
        self.position = 0
        """Frames taken."""
        self.dropped = 0
        """Frames that came without their images."""
        self._rereads = rereads
        self._fresh: deque[Stepped] = deque(maxlen=IMAGES_WAITING)
        self.finished: Finished | None = None
        """The final trajectories, while they wait."""
        self._bare: set[int] = set()
        """Frames that came without their images, and have not got them since."""
        self._looked_at: deque[int] = deque(maxlen=PEOPLE * 2)
        """Frames whose images are wanted: for each viewer those of each camera."""
        self._end: int | None = None
        self._closed = False
        self._news = Condition()

    def offer(self, event: Stepped) -> None:
        """The newest frame of the history, with its images."""
        with self._news:
            self._fresh.append(event)
            self._news.notify()

    def look_at(self, index: int) -> None:
        """A frame is shown to somebody: where its images, or the other camera's latest, were left out, they come
        as soon as may be."""
        kinds = self.opened.sequence.kinds
        drawn = {next((i for i in range(index, -1, -1) if kinds[i] == kind), index) for kind in ("video", "stereo")}
        with self._news:
            self._looked_at.extend(sorted(drawn))
            self._news.notify()

    def request(self, index: int) -> None:
        """The images of a frame are needed again, whatever became of them."""
        with self._news:
            if index < self.position:
                self._bare.add(index)
                self._looked_at.append(index)
            self._news.notify()

    def finish(self, finished: Finished | None, *, ends: bool = False) -> None:
        """The final trajectories come after all that the history holds by now; with `ends`, nothing comes after."""
        with self._news:
            if self._end is None:
                self.finished = finished
                self._end = self.history.computed if ends else None
            self._news.notify()

    def skip(self) -> None:
        """What waits is given up, except for the final trajectories."""
        with self._news:
            self._end = self.position
            self._news.notify()

    def close(self) -> None:
        """Nothing comes any more."""
        with self._news:
            self._closed = True
            self._news.notify()

    def pause(self, seconds: float) -> None:
        """Waits so long, or until it is closed."""
        with self._news:
            self._news.wait_for(lambda: self._closed, seconds)

    @property
    def ending(self) -> bool:
        """Whether the last event is known."""
        return self._end is not None or self._closed

    def take(self) -> Event | None:
        """The next event, waiting for it; None when no more will come."""
        with self._news:
            self._news.wait_for(self._ready)
            if self._closed:
                return None
            pictured, index, fresh = self._pictured(), self.position, None
            if pictured is None and not self._waiting:
                finished, self.finished = self.finished, None
                return finished
            if pictured is None:
                while self._fresh and self._fresh[0].index < index:
                    self._fresh.popleft()
                fresh = self._fresh.popleft() if self._fresh and self._fresh[0].index == index else None
        if pictured is not None:
            self._bare.discard(pictured)
            return Pictured(pictured, self._read(pictured), self.history[pictured].steps)
        event = fresh or self._later(index)
        self.position += 1
        return event

    def _ready(self) -> bool:
        ended = self.finished is not None or self._end is not None
        return self._closed or self._waiting or ended or self._pictured() is not None

    def _pictured(self) -> int | None:
        """A frame whose images are missed, of those that are looked at the newest."""
        return next((index for index in reversed(self._looked_at) if index in self._bare), None)

    @property
    def empty(self) -> bool:
        """Whether all that came so far was taken."""
        return not self._waiting and self.finished is None

    @property
    def _waiting(self) -> bool:
        return self.position < (self.history.computed if self._end is None else self._end)

    def _later(self, index: int) -> Stepped:
        """A frame whose images did not wait."""
        record = self.history[index]
        if self._rereads:
            return record.stepped(self._read(index))
        self.dropped += 1
        self._bare.add(index)
        return record.stepped(blank(self.opened.sequence, index))

    def _read(self, index: int) -> Measurement:
        try:
            return self.opened.sequence[index]
        except UnreadableImage:  # it was skipped in the run, too, or went missing since
            return blank(self.opened.sequence, index)
