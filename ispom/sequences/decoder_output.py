"""Silences decoders that write to the process's standard error: errors are reported by one sentence of ISPOM
instead."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2

STDERR = 2
"""Descriptor of the standard error, by the POSIX standard."""


def quiet_decoders() -> None:
    """Silences FFmpeg from its first use on, unless OPENCV_FFMPEG_LOGLEVEL is set."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    warnings.filterwarnings("ignore", module=r"PIL\.")


def film_name(path: Path) -> str:
    """Returns the name by which FFmpeg opens a file: it takes the beginning of a relative path such as 12:a for the
    name of a protocol."""
    return os.path.abspath(path)


class _Silence:
    """Redirects descriptor 2 to nowhere while any thread requires it."""

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
    """Discards the output of C code on descriptor 2 in its context: libpng and libjpeg cannot be silenced otherwise.

    Can be used from several threads. Python's own standard error is lost as well, unless it has another descriptor.
    """
    _silence.begin()
    try:
        yield
    finally:
        _silence.end()


def _redirected() -> int:
    """Redirects descriptor 2 to nowhere; returns a copy of the old one, -1 where it was closed."""
    try:
        copy = os.dup(STDERR)
    except OSError:
        return -1
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, STDERR)
    os.close(nowhere)
    return copy


quiet_decoders()
