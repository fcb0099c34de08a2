"""Decoders that write about what they meet on the process's standard error, silenced: the one sentence is ours."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2

STDERR = 2


def quiet_decoders() -> None:
    """From the first use of FFmpeg on, unless the person asks it for more by OPENCV_FFMPEG_LOGLEVEL."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    warnings.filterwarnings("ignore", module=r"PIL\.")


def film_name(path: Path) -> str:
    """What FFmpeg is to open: of a relative path that begins with 12: it takes 12 for the name of a protocol."""
    return os.path.abspath(path)


class _Silence:
    """Descriptor 2 leads to nowhere for as long as anyone wants it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users, self._stderr_copy = 0, -1

    def begin(self) -> None:
        with self._lock:
            if self._users == 0:
                self._stderr_copy = _redirected()
            self._users += 1

    def end(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0 and self._stderr_copy >= 0:
                os.dup2(self._stderr_copy, STDERR)
                os.close(self._stderr_copy)


_silence = _Silence()


@contextmanager
def silenced() -> Iterator[None]:
    """Meanwhile what C code writes to descriptor 2 goes nowhere: libpng and libjpeg have no other switch.

    Safe from several threads. Python's own standard error is lost as well, unless it has another descriptor.
    """
    _silence.begin()
    try:
        yield
    finally:
        _silence.end()


def _redirected() -> int:
    """Descriptor 2 led to nowhere; a copy of what it was, -1 where it was closed."""
    try:
        copy = os.dup(STDERR)
    except OSError:
        return -1
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, STDERR)
    os.close(nowhere)
    return copy


quiet_decoders()
