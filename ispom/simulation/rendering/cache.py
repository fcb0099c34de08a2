"""Rendered images on disk, lossless and checked when read, and background threads that render ahead."""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import tempfile
import threading
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from ispom.stop import wait_or_stop
from ispom.types import Image

log = logging.getLogger(__name__)
_DIGEST_BYTES = 16
_PACKAGE = Path(__file__).parents[1]
_NOT_RENDERED = {"cache", "filmed_board", "process", "truth"}
"""Modules that do not change what is rendered."""
NOWHERE = Path(os.devnull)
"""In place of a folder: images are not kept, whose folder gives away the seed, and what comes next."""
_KEPT_FOLDERS = 4
"""Rendered sequences that stay on disk, about 0.7 GB each; the least recently used ones go first."""
_IN_USE_S = 3600.0
"""Folders used within this time may be in use by another process: they stay, and so do its unfinished files."""


def default_folder() -> Path:
    """Returns the default place of rendered images: the user's cache folder."""
    return Path(platformdirs.user_cache_dir("ispom", appauthor=False)) / "simulated"


def anything_rendered() -> bool:
    """Returns whether the user's cache folder holds a simulation: an app can start without rendering at once."""
    return any(default_folder().glob("*/*.png"))


def source_key(*values: object) -> str:
    """Returns a name for what these values and the code of this package render."""
    digest = hashlib.blake2b(digest_size=12)
    for file in sorted([*_PACKAGE.glob("*.py"), *_PACKAGE.glob("rendering/*.py"), *_PACKAGE.glob("places/*.py")]):
        if file.stem not in _NOT_RENDERED:
            digest.update(file.read_bytes())
    digest.update(repr(values).encode())
    return digest.hexdigest()


@dataclass(frozen=True)
class ImageCache:
    """A folder of images, each a PNG followed by a digest of its bytes."""

    folder: Path

    @staticmethod
    def open(parent: Path, key: str) -> ImageCache:
        """Opens the cache `key` in a parent folder, and deletes the ones there that were not used lately."""
        if parent == NOWHERE:
            return ImageCache(NOWHERE)
        folder = parent / key
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
            others = sorted((f for f in parent.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime)
            for old in filter(_unused, others[:-_KEPT_FOLDERS]):
                shutil.rmtree(old, ignore_errors=True)
            for part in filter(_unused, folder.glob("*.part")):  # of a process that was killed
                part.unlink()
        return ImageCache(folder)

    def has(self, name: str) -> bool:
        return (self.folder / f"{name}.png").exists()

    def read(self, name: str) -> Image | None:
        """Returns the RGB image, or None where there is none or its bytes are not the ones written."""
        try:
            raw = (self.folder / f"{name}.png").read_bytes()
        except OSError:
            return None
        body, digest = raw[:-_DIGEST_BYTES], raw[-_DIGEST_BYTES:]
        if not body or _digest(body) != digest:
            return None
        with suppress(OSError):
            os.utime(self.folder)
        image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
        return None if image is None else np.ascontiguousarray(image[:, :, ::-1], np.uint8)

    def write(self, name: str, image: Image) -> bool:
        """Returns whether it is on disk now: a full or read-only disk only costs the next run its time."""
        if self.folder == NOWHERE:
            return False
        body = cv2.imencode(
            ".png",
            cv2.cvtColor(image, cv2.COLOR_RGB2BGR),
            [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY],
        )[1].tobytes()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)  # the cache may have been emptied meanwhile
            handle, part = tempfile.mkstemp(dir=self.folder, suffix=".part")
        except OSError as fault:
            return _not_kept(self.folder, fault)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(body + _digest(body))
            os.replace(part, self.folder / f"{name}.png")
        except OSError as fault:
            with suppress(OSError):
                os.unlink(part)
            return _not_kept(self.folder, fault)
        return True


@cache
def _warn(folder: Path, reason: str) -> None:
    """Once for each folder and reason, not for each image."""
    log.warning("rendered images cannot be kept in %s (%s): they are rendered again the next time", folder, reason)


def _not_kept(folder: Path, fault: OSError) -> bool:
    _warn(folder, fault.strerror or str(fault))
    return False


def _unused(path: Path) -> bool:
    return time.time() - path.stat().st_mtime > _IN_USE_S


def _digest(body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=_DIGEST_BYTES).digest()


_AT_ONCE = 2
"""Images made at the same time in the background, while few are ahead; else one, and the consumer has the rest."""
_KEPT_IMAGES = 16
"""The last images made or read stay in memory: nothing rendered ahead is decoded again, and no disk is needed."""


class AheadRenderer:
    """Images 0..count-1 by index: from memory, from disk, or rendered by the first thread that needs them.

    No image is rendered twice. Safe from several threads.
    """

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
        """Renders images from i on in the background, from now on.

        The threads have no lower priority than others: the consumer waits for the image in work, and would wait long
        next to a browser that uses every core.
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
        """Returns the first of the next `reach` images that does not exist; without a disk, no farther than memory
        reaches."""
        reach = reach if self._on_disk else min(reach, _KEPT_IMAGES // 2)
        for i in range(self._cursor, min(len(self._names), self._cursor + reach)):
            if i not in self._recent and i not in self._in_work and not self._cache.has(self._names[i]):
                return i
        return None


def _work(owner: weakref.ref[AheadRenderer], wake: threading.Condition, reach: int) -> None:
    """Runs a background thread: lives as long as its owner and the main thread, and refers to the owner only while it
    works.

    Not a daemon: those are cut off in native code while its libraries unload, and the process crashes.
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
        except Exception:  # the thread that requests this image gets the error; at process exit there is none
            return
        del renderer
