"""Rendering ahead: background threads fill what the consumer will ask for next; nothing is computed twice."""

from __future__ import annotations

import os
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, wait

from ispom.simulation.cache import ImageCache
from ispom.stop import wait_or_stop
from ispom.types import Image

_AT_ONCE = 2
"""Images made at the same time in the background, while few are ahead; else one, and the consumer has the rest."""
_KEPT_IMAGES = 16
"""The last images made or read stay in memory: nothing rendered ahead is decoded again, and no disk is needed."""


class AheadRenderer:
    """Images 0..count-1 by index: from memory, from disk, or made by whoever asks first. Safe from several threads."""

    def __init__(self, names: list[str], make: Callable[[int, int], Image], cache: ImageCache) -> None:
        """`names` in the cache; `make(i, threads)` renders, the same bytes for any number of threads."""
        self._names, self._make, self._cache = names, make, cache
        self._lock = threading.Lock()
        self._wake = threading.Condition(self._lock)
        self._in_work: dict[int, Future[Image]] = {}
        self._recent: OrderedDict[int, Image] = OrderedDict()
        self._cursor = 0
        self._on_disk = True
        self._stopping = False
        self._threads: list[threading.Thread] = []

    def get(self, i: int) -> Image:
        """Image i, waiting for the thread that is making it, or making it here."""
        with self._lock:
            self._cursor = i + 1
            self._wake.notify_all()
        return self._obtain(i, os.cpu_count() or 1)

    def prepare(self, i: int) -> None:
        """Makes images from i on in the background, from now on.

        At no lower priority than others: the consumer waits for the image in work, and would wait long
        beside a browser that takes every core.
        """
        with self._lock:
            self._cursor = i
            self._wake.notify_all()
            self._threads = [thread for thread in self._threads if thread.is_alive()]
            if not self._threads:
                ends = [len(self._names), *[_KEPT_IMAGES // 2] * (_AT_ONCE - 1)]
                work = [(weakref.ref(self), self._wake, end) for end in ends]
                self._threads = [threading.Thread(target=_work, args=a, name="render-ahead") for a in work]
                for thread in self._threads:
                    thread.start()

    def stop(self) -> None:
        """Ends the background threads after the images in work."""
        with self._lock:
            self._stopping = True
            self._wake.notify_all()
            threads = list(self._threads)
        for thread in threads:
            if thread is not threading.current_thread():
                thread.join()

    def _obtain(self, i: int, threads: int) -> Image:
        with self._lock:
            if i in self._recent:
                self._recent.move_to_end(i)
                return self._recent[i]
            claimed = self._in_work.get(i)
            if claimed is None:
                mine = self._in_work[i] = Future()
        if claimed is not None:
            wait_or_stop(lambda seconds: bool(wait([claimed], seconds).done))
            return claimed.result()
        try:
            image = self._cache.read(self._names[i])
            if image is None:
                image = self._make(i, threads)
                self._on_disk = self._cache.write(self._names[i], image)
            image.setflags(write=False)
        except BaseException as error:
            with self._lock:
                del self._in_work[i]
            mine.set_exception(error)
            raise
        with self._lock:
            del self._in_work[i]
            self._recent[i] = image
            if len(self._recent) > _KEPT_IMAGES:
                self._recent.popitem(last=False)
        mine.set_result(image)
        return image

    def _next(self, reach: int) -> int | None:
        """The first of `reach` images on that nobody has made; without a disk, not further than memory reaches."""
        reach = reach if self._on_disk else min(reach, _KEPT_IMAGES // 2)
        for i in range(self._cursor, min(len(self._names), self._cursor + reach)):
            if i not in self._recent and i not in self._in_work and not self._cache.has(self._names[i]):
                return i
        return None


def _work(owner: weakref.ref[AheadRenderer], wake: threading.Condition, reach: int) -> None:
    """A background thread: lives as long as its owner and the main thread do, and holds the owner only while it works.

    Not a daemon: those are cut off in the middle of native code while its libraries unload, and the process crashes.
    """
    while threading.main_thread().is_alive():
        with wake:
            renderer = owner()
            if renderer is None or renderer._stopping:
                return
            i = renderer._next(reach)
            if i is None:
                del renderer
                wake.wait(0.5)
                continue
        try:
            renderer._obtain(i, max(1, (os.cpu_count() or 1) - 1))
        except Exception:  # whoever asks for that image meets the error; at process exit nobody does
            return
        del renderer
