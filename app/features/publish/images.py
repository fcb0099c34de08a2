"""What a published stage keeps of the images: as recorded, or smaller."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import pyarrow as pa

from ...views.rerun.parts import IMAGE

BLOB = f"{IMAGE}:blob"
SAMPLES = 60
"""Images from which the size of all is estimated."""


@dataclass(frozen=True)
class Images:
    """What is kept of the images."""

    quality: int | None = None
    """Of JPEG, 1..100; None for as they were recorded."""
    right: bool = True
    """Whether those of the right camera are kept."""
    every: int = 1
    """Of each camera every n-th image is kept; 0 for none."""

    def __str__(self) -> str:
        if not self.every:
            return "none"
        parts = ["as recorded" if self.quality is None else f"JPEG quality {self.quality}"]
        parts += [] if self.right else ["none of the right camera"]
        parts += [] if self.every == 1 else [f"one of {self.every}"]
        return ", ".join(parts)


CHOICES = (
    Images(),
    *(Images(quality) for quality in (70, 50, 35, 25)),
    *(Images(quality, right=False) for quality in (35, 25, 15)),
    *(Images(25, right=False, every=every) for every in (2, 4, 8, 16, 32, 64)),
    Images(every=0),
)
"""Choices of images, from the best to the smallest."""


def is_image(columns: pa.RecordBatch) -> bool:
    return BLOB in columns.schema.names


def kept(rows: Iterable[tuple[str, pa.RecordBatch]], images: Images) -> Iterator[pa.RecordBatch]:
    """Rows of entities, those of images as `images` says. An image that is not kept leaves an empty row: without it the
    viewer would show the one before."""
    seen = Counter[str]()
    for path, columns in rows:
        if not is_image(columns):
            yield columns
            continue
        seen[path] += 1
        if _is_kept(path, seen[path] - 1, images):
            blob = None if images.quality is None else smaller(_blob(columns), images.quality)
            yield columns if blob is None else _with_blob(columns, [blob])
        else:
            yield _with_blob(columns, [])


def estimated_bytes(rows: Iterable[tuple[str, pa.RecordBatch]], images: Images) -> int:
    """What the images take in a compressed file, from a sample of them."""
    seen, found = Counter[str](), list[bytes]()
    for path, columns in rows:
        if is_image(columns):
            seen[path] += 1
            if _is_kept(path, seen[path] - 1, images):
                found.append(_blob(columns))
    sample = found[:: -(-len(found) // SAMPLES)] if found else []
    sizes = [len(zlib.compress(each if images.quality is None else smaller(each, images.quality))) for each in sample]
    return round(sum(sizes) / len(sizes) * len(found)) if sizes else 0


def smaller(content: bytes, quality: int) -> bytes:
    """The image as JPEG of this quality, or as it is where that is smaller, or where it cannot be decoded."""
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        return content
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])
    return data.tobytes() if done and len(data) < len(content) else content


def _is_kept(path: str, number: int, images: Images) -> bool:
    return bool(images.every) and number % images.every == 0 and (images.right or not path.startswith("/right/"))


def _blob(columns: pa.RecordBatch) -> bytes:
    found = columns.column(BLOB)[0]
    return b"" if not found.is_valid or not len(found) else np.asarray(found.values[0].values, np.uint8).tobytes()


def _with_blob(columns: pa.RecordBatch, blobs: list[bytes]) -> pa.RecordBatch:
    """The row with this blob, or none."""
    at = columns.schema.get_field_index(BLOB)
    field = columns.schema.field(at)
    values = [np.frombuffer(blob, np.uint8) for blob in blobs]
    return columns.set_column(at, field, pa.array([values], type=field.type))
