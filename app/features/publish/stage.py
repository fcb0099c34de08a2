"""The stage of a published page: what the recording of the run shows, in pieces for the Rerun viewer.

    file = gzip(piece*)          piece = size (4 bytes, big-endian)  `.rrd` stream

The first piece has the layout and what holds for the whole run. The others have what the page draws over time, in the
order of the frames, on the timeline `exposure` alone: the page puts Rerun's time cursor there. Each ends with a row on
the timeline `stage`, by which the page knows which pieces the viewer has taken in. Curves, texts and times of day stay
out. Messages are not compressed one by one, so that gzip finds what they have in common.
"""

from __future__ import annotations

import gzip
import re
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk, RrdReader

from ispom.errors import InputError

from ...views.rerun.batch import Entry
from ...views.rerun.parts import FLUSH_S, STAGE, columns_of, is_part
from ...views.rerun.rrd import HEADER, messages, uncompressed
from ...views.rerun.stored_tape import TIMELINE, StoredTape
from ...views.rerun.streams import APPLICATION
from .images import CHOICES, Images, estimated_bytes, kept

PIECE_BYTES = 4 << 20
"""Size of a piece before it is compressed: even with software graphics, the viewer loads one within seconds."""
UNSEEN = re.compile(r"/decisions|/.+/coloured/.+")
"""Texts, which the page has as verdicts and checks, and other colours of the tracks, which it cannot choose."""
STEPS_PER_PX = 16
"""Places in images are rounded to such fractions of a pixel: nobody sees that, and they take a third less."""
LEAST_SHARE = 0.7
"""Least ratio of the true to the estimated size of images, as small ones have more in common. Sizes that may fit are
tried."""
LEVEL = 9
"""Compression level of gzip."""


@dataclass(frozen=True)
class Stage:
    """The file, and what a page must know of it."""

    content: bytes
    recording: str
    """The id of the recording, by which the viewer knows it."""
    frames: tuple[int, ...]
    """By piece from the second on, the last frame that it has."""
    images: Images
    image_bytes: int = 0
    """What the file would have less without any image."""


class StageWriter:
    """Reads a recording once, and makes stages of it with different images."""

    def __init__(
        self, recording: Path, overlay: Iterable[Entry] = (), layout: Callable[[str], bytes] | None = None
    ) -> None:
        """`overlay` is drawn over all frames; `layout` as of StoredTape. InputError where the file is no finished
        recording of this version."""
        tape = StoredTape(recording, layout=layout)
        self._recording_id, self._opening = tape.recording_id, uncompressed(tape.opening())
        tape.close()
        self._overlay = [columns_of(entry.path, entry.value) for entry in overlay]
        try:
            rows = [row for chunk in RrdReader(recording).stream().to_chunks() for row in _rows(chunk)]
        except (OSError, RuntimeError, ValueError) as error:
            raise InputError(f"{recording} is damaged ({error}): run again") from None
        self._rows = sorted(rows, key=lambda row: row[0])

    def fitting(self, most_bytes: float, beside: Callable[[Stage], int]) -> Stage:
        """Returns the stage with the best images among CHOICES with which its file takes at most `most_bytes`; that
        includes what other files say of it: `beside` gives their bytes. InputError where the stage without any image is
        larger."""

        def fits(stage: Stage) -> bool:
            return len(stage.content) + beside(stage) <= most_bytes

        least, whole = self.stage(CHOICES[-1]), self.stage(CHOICES[0])
        bare = len(least.content)
        if fits(whole):
            return replace(whole, image_bytes=len(whole.content) - bare)
        if not fits(least):
            raise InputError(f"the stage takes {bare / 1e6:.1f} MB without any image: give a higher --max-mb")
        # gzip finds what images have in common
        share = (len(whole.content) - bare) / max(estimated_bytes(self._entities(), CHOICES[0]), 1)
        for images in CHOICES[1:-1]:
            if bare + LEAST_SHARE * share * estimated_bytes(self._entities(), images) <= most_bytes:
                found = self.stage(images)
                if fits(found):
                    return replace(found, image_bytes=len(found.content) - bare)
        return least

    def stage(self, images: Images) -> Stage:
        """The file with these images."""
        pieces, frames = [HEADER + self._opening], list[int]()
        for serial, (last, rows) in enumerate(_cut(self._frames(), kept(self._entities(), images)), 1):
            static = self._overlay if serial == 1 else []
            pieces.append(_piece(self._recording_id, serial, rows, static))
            frames.append(last)
        packed = b"".join(struct.pack(">I", len(piece)) + piece for piece in pieces)
        content = gzip.compress(packed, LEVEL, mtime=0)
        return Stage(content, self._recording_id, tuple(frames), images)

    def _frames(self) -> Iterator[int]:
        return (frame for frame, _, _ in self._rows)

    def _entities(self) -> Iterator[tuple[str, pa.RecordBatch]]:
        return ((path, columns) for _, path, columns in self._rows)


def _rows(chunk: Chunk) -> Iterator[tuple[int, str, pa.RecordBatch]]:
    """Frame, path and columns of each row that the page draws."""
    batch = chunk.to_record_batch()
    path = str(chunk.entity_path)
    if TIMELINE not in batch.schema.names or not is_part(path) or UNSEEN.fullmatch(path):
        return
    fields = [
        (i, field)
        for i, field in enumerate(batch.schema)
        if (field.metadata or {}).get(b"rerun:kind") != b"index" or field.name == TIMELINE
    ]
    schema = pa.schema([field for _, field in fields], {b"rerun:entity_path": path.encode()})
    values = [rounded(batch.column(i)) if _is_in_image(path, field) else batch.column(i) for i, field in fields]
    columns = pa.record_batch(values, schema)
    for row, frame in enumerate(batch.column(TIMELINE).to_pylist()):
        if frame is not None:
            yield int(frame), path, columns.slice(row, 1)


def _is_in_image(path: str, field: pa.Field) -> bool:
    """Whether the values are places in an image."""
    return not path.startswith("/world/") and field.name.endswith((":positions", ":strips"))


def rounded(array: pa.Array) -> pa.Array:
    """Lists of lists of float32, rounded to fractions of a pixel; NaN stays."""
    if pa.types.is_float32(array.type):
        return pa.array(np.round(array.to_numpy() * STEPS_PER_PX) / STEPS_PER_PX, array.type)
    if not (pa.types.is_list(array.type) or pa.types.is_fixed_size_list(array.type)):
        return array
    own = array.buffers()[: array.type.num_buffers]
    return pa.Array.from_buffers(array.type, len(array), own, offset=array.offset, children=[rounded(array.values)])


def _cut(frames: Iterable[int], rows: Iterable[pa.RecordBatch]) -> Iterator[tuple[int, list[pa.RecordBatch]]]:
    """Rows in pieces of whole frames, each with its last frame."""
    found, size, last = list[pa.RecordBatch](), 0, 0
    for frame, columns in zip(frames, rows, strict=True):
        if size > PIECE_BYTES and frame > last:
            yield last, found
            found, size = [], 0
        last = frame
        found.append(columns)
        size += columns.nbytes
    yield last, found


def _piece(recording_id: str, serial: int, rows: list[pa.RecordBatch], static: list[pa.RecordBatch]) -> bytes:
    """An `.rrd` stream of these rows: those of one entity with the same columns are one chunk."""
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    unread = rr.binary_stream(stream)
    alike: dict[tuple[object, ...], list[pa.RecordBatch]] = {}
    for columns in rows:
        key = (columns.schema.metadata[b"rerun:entity_path"], *columns.schema.names)
        alike.setdefault(key, []).append(columns)
    for batches in alike.values():
        same = [pa.record_batch(each.columns, batches[0].schema) for each in batches]
        rr.send_chunks(Chunk.from_record_batch(pa.concat_batches(same)), recording=stream)
    for columns in static:
        rr.send_chunks(Chunk.from_record_batch(columns, index=None), recording=stream)
    row = rr.Scalars.columns(scalars=[float(serial)])
    rr.send_chunks(Chunk.from_columns(STAGE, [rr.TimeColumn(STAGE, sequence=[serial])], row), recording=stream)
    content = messages(unread.read(flush_timeout_sec=FLUSH_S))
    stream.disconnect()
    return HEADER + uncompressed(content)
