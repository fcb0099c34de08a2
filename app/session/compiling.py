"""The first compilation, as the page shows it: how far it is, or why it failed."""

from __future__ import annotations

from collections.abc import Callable

from ispom.methods import Config

from ..engine import warmup
from ..engine.playback import Playback
from .state import Activity, NoticeAdded, changed
from .store import Store

WAIT_S = 0.05
"""For the compiler at a time, before the session looks at its commands again."""


class Compiling:
    """`start(methods, config)` begins to compile what they need."""

    def __init__(self, store: Store, start: Callable[[tuple[str, ...], Config], None]) -> None:
        self._store, self._start = store, start
        self._failure: str | None = None
        """The one that was shown."""

    def begin(self, playback: Playback) -> None:
        """A run of these methods is about to start."""
        self._start(playback.methods, playback.config)

    def over(self, playback: Playback) -> bool:
        """Whether the next frame may be computed; neither waits nor shows anything."""
        return warmup.ready(playback.methods, playback.config)

    def ready(self, playback: Playback) -> bool:
        """Whether the next frame may be computed; otherwise shows what it waits for, a little while."""
        if warmup.ready(playback.methods, playback.config, WAIT_S):
            return True
        before, text = self._store.state.activity, warmup.message(playback.methods, playback.config)
        if before is None or not before.text.startswith(warmup.MESSAGE):
            self._store.busy(text)
        elif before.text != text:
            self._store.emit(changed(activity=Activity(text, before.since_s)))
        return False

    def watch(self) -> None:
        """Shows how far it is, and what became of it, whether the run goes on or not."""
        over = warmup.finished()
        self._store.set(compiling="" if over else warmup.message())
        failure = warmup.failure()
        if failure is not None and failure != self._failure:
            self._store.emit(NoticeAdded(failure))
        self._failure = failure
