"""The events of one run for a thread that draws or writes them at its own pace. The run never waits for this thread.
Events that it has not taken yet are not stored; they are read from the history."""

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
"""Largest number of viewers that look at different frames and still get their images."""


class Feed:
    """The feed of one run, from its first frame on. `offer`, `finish` and `close` never wait; one other thread calls
    `take`."""

    def __init__(self, opened: Opened, history: History, *, rereads: bool) -> None:
        """`history` is that of this run. `rereads`: images that are no longer in memory are read from the sequence
        again. Otherwise such a frame comes without images and is counted in `dropped`."""
        self.opened, self.history = opened, history
        self.position = 0
        """Number of frames that were taken."""
        self.dropped = 0
        """Number of frames that came without their images."""
        self._rereads = rereads
        self._fresh: deque[Stepped] = deque(maxlen=IMAGES_WAITING)
        self.finished: Finished | None = None
        """The final trajectories, until they are taken."""
        self._bare: set[int] = set()
        """Frames that came without their images and still lack them."""
        self._looked_at: deque[int] = deque(maxlen=PEOPLE * 2)
        """Frames whose images are needed: for each viewer one of each camera."""
        self._end: int | None = None
        self._closed = False
        self._news = Condition()

    def offer(self, event: Stepped) -> None:
        """Takes the newest frame of the history, with its images."""
        with self._news:
            self._fresh.append(event)
            self._news.notify()

    def look_at(self, index: int) -> None:
        """Says that somebody looks at a frame. If its images or the latest ones of the other camera are missing, they
        come next."""
        kinds = self.opened.sequence.kinds
        drawn = {next((i for i in range(index, -1, -1) if kinds[i] == kind), index) for kind in ("video", "stereo")}
        with self._news:
            self._looked_at.extend(sorted(drawn))
            self._news.notify()

    def request(self, index: int) -> None:
        """Requests the images of a frame again, even if they were delivered before."""
        with self._news:
            if index < self.position:
                self._bare.add(index)
                self._looked_at.append(index)
            self._news.notify()

    def finish(self, finished: Finished | None, *, ends: bool = False) -> None:
        """Delivers the final trajectories after all frames that the history has now; with `ends`, nothing follows."""
        with self._news:
            if self._end is None:
                self.finished = finished
                self._end = self.history.computed if ends else None
            self._news.notify()

    def skip(self) -> None:
        """Discards what was not taken yet, except for the final trajectories."""
        with self._news:
            self._end = self.position
            self._news.notify()

    def close(self) -> None:
        """Ends the feed: `take` returns None from now on."""
        with self._news:
            self._closed = True
            self._news.notify()

    def pause(self, seconds: float) -> None:
        """Waits for `seconds`, or until the feed is closed."""
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
        """Returns the newest of the frames that are looked at whose images are missing; None without one."""
        return next((index for index in reversed(self._looked_at) if index in self._bare), None)

    @property
    def empty(self) -> bool:
        """Whether all that came so far was taken."""
        return not self._waiting and self.finished is None

    @property
    def _waiting(self) -> bool:
        return self.position < (self.history.computed if self._end is None else self._end)

    def _later(self, index: int) -> Stepped:
        """Returns a frame whose images are no longer in memory."""
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
