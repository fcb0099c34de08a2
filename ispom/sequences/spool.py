"""Images of one size in an unnamed temporary file, which is deleted when the program ends, for whatever reason."""

from __future__ import annotations

import shutil
from tempfile import TemporaryFile, gettempdir
from threading import Lock

import numpy as np

from ispom.errors import InputError
from ispom.types import Image

MAX_BYTES = 8 << 30
"""Largest size of the file."""
MAX_DISK_SHARE = 0.5
"""Largest share of the free space for temporary files."""


class Spool:
    """A store of images, to which one thread appends, and from which any thread reads."""

    def __init__(self, shape: tuple[int, ...], max_images: int | None = None) -> None:
        """Raises InputError where there is no room for any image."""
        self._shape, self._bytes = shape, int(np.prod(shape))
        self.limit = f"the space for temporary files in {gettempdir()}"
        free = int(shutil.disk_usage(gettempdir()).free * MAX_DISK_SHARE)
        room = min(MAX_BYTES, free) // self._bytes
        if not room:
            raise InputError(f"{self.limit} is used up: make room, or name another place in TMPDIR")
        self.capacity = room if max_images is None else min(room, max_images)
        self._bounded_by_room = self.capacity == room
        self._count = 0
        self._lock = Lock()
        self._file = TemporaryFile(prefix="ispom-live-")  # noqa: SIM115 (closed with the last sequence that reads it)

    @property
    def full(self) -> bool:
        """Whether the disk space is used up, and not only the requested number of images."""
        return self._bounded_by_room and self._count == self.capacity

    def append(self, image: Image) -> None:
        """Raises InputError where the disk does not take it."""
        try:
            with self._lock:
                self._file.seek(self._count * self._bytes)
                self._file.write(np.ascontiguousarray(image).tobytes())
                self._count += 1
        except OSError as error:
            raise InputError(
                f"{self.limit} cannot be written to ({error.strerror}): make room, or name another place in TMPDIR"
            ) from None

    def read(self, i: int) -> Image:
        """Returns image i, read-only."""
        with self._lock:
            self._file.seek(i * self._bytes)
            content = self._file.read(self._bytes)
        return np.frombuffer(content, np.uint8).reshape(self._shape)
