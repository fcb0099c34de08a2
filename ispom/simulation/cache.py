"""Rendered exposures on disk: lossless, checked when read, and never a reason to fail."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from ispom.types import Image

_DIGEST_BYTES = 16
_KEPT_FOLDERS = 4
"""Rendered sequences that stay on disk, about 0.7 GB each; the least recently opened ones go first."""


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
        digest.update(file.read_bytes())
    digest.update(repr(values).encode())
    return digest.hexdigest()


@dataclass(frozen=True)
class ImageCache:
    """A folder of images, each a PNG followed by a digest of its bytes."""

    folder: Path

    @staticmethod
    def open(parent: Path, key: str) -> ImageCache:
        """The cache `key` in a parent folder; the ones there that nobody opened lately are deleted."""
        folder = parent / key
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
            others = sorted((f for f in parent.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime)
            for old in others[:-_KEPT_FOLDERS]:
                shutil.rmtree(old, ignore_errors=True)
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
            handle, part = tempfile.mkstemp(dir=self.folder, suffix=".part")
        except OSError:
            return False
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(body + _digest(body))
            os.replace(part, self.folder / f"{name}.png")
        except OSError:
            with suppress(OSError):
                os.unlink(part)
            return False
        return True


def _digest(body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=_DIGEST_BYTES).digest()
