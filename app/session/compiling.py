"""Shows the first compilation on the page: its progress, or why it failed."""

from __future__ import annotations

from collections.abc import Callable

from ispom.methods import Config

from ..engine import warmup
from ..engine.playback import Playback
from .state import Activity, NoticeAdded, changed
from .store import Store

WAIT_S = 0.05
"""Longest wait for the compiler before the session looks for commands again."""


class Compiling:
    """Starts the compilation and shows it. `start(methods, config)` begins to compile what they need."""

    def __init__(self, store: Store, start: Callable[[tuple[str, ...], Config], None]) -> None:
        self._store, self._start = store, start
        self._failure: str | None = None
        """The failure that was shown last."""

    def begin(self, playback: Playback) -> None:
        """Begins to compile for a run that is about to start."""
        self._start(playback.methods, playback.config)

    def over(self, playback: Playback) -> bool:
        """Returns whether the next frame can be computed. It does not wait and shows nothing."""
        return warmup.ready(playback.methods, playback.config)

    def ready(self, playback: Playback) -> bool:
        """Returns whether the next frame can be computed. If not, it waits for WAIT_S and shows the progress."""
        if warmup.ready(playback.methods, playback.config, WAIT_S):
            return True
        before, text = self._store.state.activity, warmup.message(playback.methods, playback.config)
        if before is None or not before.text.startswith(warmup.MESSAGE):
            self._store.busy(text)
        elif before.text != text:
            self._store.emit(changed(activity=Activity(text, before.since_s)))
        return False

    def watch(self) -> None:
        """Shows the progress of the compilation, or its failure."""
        over = warmup.finished()
        self._store.set(compiling="" if over else warmup.message())
        failure = warmup.failure()
        if failure is not None and failure != self._failure:
            self._store.emit(NoticeAdded(failure))
        self._failure = failure
