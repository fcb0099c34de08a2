"""Rendered exposures on disk: lossless, checked when read, and never a reason to fail."""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from ispom.types import Image

log = logging.getLogger(__name__)
_DIGEST_BYTES = 16
_WITHOUT_PIXELS = {"ahead", "board", "cache", "faults", "filming", "laser", "process", "truth"}
"""Modules whose code does not shape what is rendered."""
_KEPT_FOLDERS = 4
"""Rendered sequences that stay on disk, about 0.7 GB each; the least recently used ones go first."""
_IN_USE_S = 3600.0
"""What was used so lately may be another app's at work: it stays, and so do its unfinished files."""


def default_folder() -> Path:
    """Where rendered exposures go unless told otherwise: the user's cache folder."""
    return Path(platformdirs.user_cache_dir("ispom", appauthor=False)) / "simulated"


def anything_rendered() -> bool:
    """Whether the user's cache folder holds a simulation, so that an app may start without rendering at once."""
    return any(default_folder().glob("*/*.png"))


def source_key(*values: object) -> str:
    """A name for what these values and the code of this package render."""
    digest = hashlib.blake2b(digest_size=12)
    for file in sorted(Path(__file__).parent.glob("*.py")):
        if file.stem not in _WITHOUT_PIXELS:
            digest.update(file.read_bytes())
    digest.update(repr(values).encode())
    return digest.hexdigest()


@dataclass(frozen=True)
class ImageCache:
    """A folder of images, each a PNG followed by a digest of its bytes."""

    folder: Path

    @staticmethod
    def open(parent: Path, key: str) -> ImageCache:
        """The cache `key` in a parent folder; the ones there that nobody used lately are deleted."""
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
        """The RGB image, or None where there is none or its bytes are not the ones written."""
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
        """Whether it is on disk now: a full or read-only disk only costs the next run its time."""
        body = cv2.imencode(
            ".png",
            cv2.cvtColor(image, cv2.COLOR_RGB2BGR),
            [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY],
        )[1].tobytes()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)  # somebody may have emptied the cache meanwhile
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
