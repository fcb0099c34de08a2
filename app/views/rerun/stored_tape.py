"""The bytes of finished recordings for the viewers in browsers, read from their files as they ask for them."""

from __future__ import annotations

import threading
from array import array
from bisect import bisect_left, bisect_right
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from ispom.errors import InputError
from ispom.types import Kind

from .parts import (
    CLEAR,
    Overlay,
    Part,
    Scene,
    camera_of,
    components_of,
    is_part,
    latest_of_each_camera,
)
from .rrd import chunk_at, message_starts, require_readable
from .tape import Tape

TIMELINE = "exposure"
CACHE_BYTES = 64 << 20
"""Memory for the chunks that were decoded last. Parts of neighbouring frames are in the same chunks."""
HEAD_BYTES = 16
"""Length of a message's head; the index of a file has the positions after it."""


_Message = tuple[BinaryIO, int, int]
"""File, begin and end."""


@dataclass(frozen=True)
class _Chunk:
    file: BinaryIO
    start: int
    """Position of its message in the file."""


@dataclass
class _Values:
    """The values of one part, in the order of the file: its chunks and the first frame of each."""

    chunks: list[_Chunk] = field(default_factory=list)
    firsts: list[int] = field(default_factory=list)


class StoredTape:
    """A finished recording that is read like a Tape. It may consist of several successive files."""

    def __init__(self, *paths: Path, kinds: Sequence[Kind] = (), layout: Callable[[str], bytes] | None = None) -> None:
        """`kinds` are those of the frames, where they are known. `layout` returns, for the id of the recording, the
        `.rrd` messages of a layout that replaces the recorded one. InputError where a file is no finished recording of
        this version."""
        self.run = uuid4().hex
        self.overlay = Overlay()
        self.recording_id = ""
        self._kinds = kinds
        self._lock = threading.Lock()
        self._files: list[BinaryIO] = []
        self._opening: list[_Message] = []
        """What holds for the whole run."""
        self._parts: dict[Part, _Values] = {}
        self._clears: dict[str, list[int]] = {}
        self._decoded: OrderedDict[_Chunk, pa.RecordBatch] = OrderedDict()
        self._decoded_bytes = 0
        self._last = len(kinds) - 1
        for path in paths:
            self._add(path)
        self._layout = layout(self.recording_id) if layout is not None else b""

    @property
    def end(self) -> int:
        """Frames that can be shown."""
        return max(self._last, 0) + 1

    @property
    def expected(self) -> int:
        return self.end

    def opening(self) -> bytes:
        content = []
        with self._lock:
            for file, begin, end in self._opening:
                if file.closed:
                    return b""
                file.seek(begin)
                content.append(file.read(end - begin))
        return b"".join([*content, self._layout])

    def scene(self, index: int) -> Scene:
        """What is to be shown of a frame."""
        with self._lock:
            if any(file.closed for file in self._files):
                return Scene(index, {})
            cameras = latest_of_each_camera(self._kinds, index) if self._kinds else None
            versions: dict[Part, tuple[_Chunk, int]] = {}
            for part, values in self._parts.items():
                if (found := self._latest(part, values, index)) is None:
                    continue
                frame, version = found
                camera = camera_of(part[0])
                current = cameras is None or camera is None or frame == cameras.get(camera)
                clears = self._clears.get(part[0], [])
                after = bisect_left(clears, frame)
                if current and not (after < len(clears) and clears[after] <= index):
                    versions[part] = version
        return Scene(index, versions)

    def request(self, index: int) -> None:
        """Does nothing: a recording has all its images."""

    def value(self, part: Part, version: object) -> pa.RecordBatch | None:
        """The part's columns, of one row."""
        chunk, row = version  # type: ignore[misc]
        with self._lock:
            return None if chunk.file.closed else components_of(self._batch(chunk), part[1], row)

    def any_of_each_part(self) -> dict[Part, tuple[_Chunk, int]]:
        return {part: (values.chunks[-1], 0) for part, values in self._parts.items()}

    def close(self) -> None:
        """It reads as empty from now on."""
        with self._lock:
            for file in self._files:
                file.close()

    def _add(self, path: Path) -> None:
        require_readable(path)
        try:
            file = path.open("rb")
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions") from None
        self._files.append(file)
        over_time = self._index(path, file)
        starts = array("q", (at for at, _ in message_starts(file)))
        self._opening += [(file, begin, end) for begin, end in pairwise(starts) if begin not in over_time]

    def _index(self, path: Path, file: BinaryIO) -> set[int]:
        """Stores where the parts of frames are, by the recording's index. Returns the positions of all messages with
        data that are logged over time."""
        recording = next(iter(RrdReader(path).recordings()), None)
        if recording is None:
            return set()
        self.recording_id = self.recording_id or recording.recording_id
        # No public call says where in the file a chunk is; LazyStore.stream() reads all chunks of an entity.
        _, index = RrdReader(path).store()._internal._chunk_index()
        names = set(index.schema.names)
        if f"{TIMELINE}:start" not in names:
            return set()
        paths = [path.removeprefix("/") for path in index.column("chunk_entity_path").to_pylist()]  # as a Tape has them
        offsets = index.column("chunk_byte_offset").to_pylist()
        firsts, lasts = (index.column(f"{TIMELINE}:{end}").to_pylist() for end in ("start", "end"))
        suffix = ":num_rows"
        rows = {
            name.removeprefix(f"{TIMELINE}:").partition(":")[0]: np.zeros(len(paths), np.int64)
            for name in names
            if name.startswith(f"{TIMELINE}:") and name.endswith(suffix)
        }
        for name in names:
            if name.startswith(f"{TIMELINE}:") and name.endswith(suffix):
                found = index.column(name).fill_null(0).to_numpy(zero_copy_only=False)
                rows[name.removeprefix(f"{TIMELINE}:").partition(":")[0]] += found.astype(np.int64)
        over_time = set[int]()
        for i in sorted(range(len(paths)), key=lambda i: offsets[i]):
            if firsts[i] is None:
                continue
            self._last = max(self._last, int(lasts[i])) if not self._kinds else self._last
            chunk = _Chunk(file, offsets[i] - HEAD_BYTES)
            over_time.add(chunk.start)
            if not is_part(paths[i]):
                continue
            for archetype in (name for name, counts in rows.items() if counts[i]):
                if archetype == CLEAR:
                    frames = self._frames(chunk, CLEAR)
                    self._clears.setdefault(paths[i], []).extend(int(f) for f in frames)
                else:
                    values = self._parts.setdefault((paths[i], archetype), _Values())
                    values.chunks.append(chunk)
                    values.firsts.append(int(firsts[i]))
        for clears in self._clears.values():
            clears.sort()
        return over_time

    def _latest(self, part: Part, values: _Values, index: int) -> tuple[int, tuple[_Chunk, int]] | None:
        """Returns the last value up to a frame: its frame, its chunk, and its row."""
        for at in range(bisect_right(values.firsts, index) - 1, -1, -1):
            chunk = values.chunks[at]
            frames = self._frames(chunk, part[1])
            rows = np.flatnonzero((frames >= 0) & (frames <= index))
            if len(rows):
                row = int(rows[np.lexsort([rows, frames[rows]])[-1]])
                return int(frames[row]), (chunk, row)
        return None

    def _frames(self, chunk: _Chunk, archetype: str) -> np.ndarray:
        """Returns the frame of each row; -1 where it has no values of the archetype."""
        batch = self._batch(chunk)
        frames = batch.column(TIMELINE).to_numpy().astype(np.int64)
        filled = np.zeros(len(frames), bool)
        for name in batch.schema.names:
            if name.partition(":")[0] == archetype:
                filled |= batch.column(name).is_valid().to_numpy(zero_copy_only=False)
        return np.where(filled, frames, -1)

    def _batch(self, chunk: _Chunk) -> pa.RecordBatch:
        if (found := self._decoded.get(chunk)) is not None:
            self._decoded.move_to_end(chunk)
            return found
        found = self._decoded[chunk] = chunk_at(chunk.file, chunk.start)
        self._decoded_bytes += found.nbytes
        while self._decoded_bytes > CACHE_BYTES and len(self._decoded) > 1:
            _, gone = self._decoded.popitem(last=False)
            self._decoded_bytes -= gone.nbytes
        return found


class BegunTape:
    """The tape of a run whose first frames are those of a recording until they are computed. A viewer sees one run: the
    parts of a computed frame replace the recorded ones."""

    def __init__(self, tape: Tape, recorded: StoredTape) -> None:
        self._tape, self._recorded = tape, recorded
        self.run, self.recording_id, self.overlay = tape.run, tape.recording_id, tape.overlay
        self.frames_seen, self._index = 0, -1
        """How often a viewer got another frame, and the last frame."""

    @property
    def end(self) -> int:
        """Frames that can be shown so far."""
        return max(self._tape.end, self._recorded.end) if self.opening() else 0

    @property
    def expected(self) -> int:
        return max(self._tape.expected, self._recorded.end)

    def opening(self) -> bytes:
        return self._tape.opening()

    def scene(self, index: int) -> Scene:
        """Returns the parts of a frame: the recorded ones until its own images are available."""
        if index != self._index:
            self.frames_seen, self._index = self.frames_seen + 1, index
        scene = self._tape.scene(index) if index < self._tape.end else None
        if scene is None or (scene.missing and index < self._recorded.end):
            return self._recorded.scene(index)
        return scene

    def request(self, index: int) -> None:
        """Asks for the images that a frame misses."""
        self._tape.request(index)

    def value(self, part: Part, version: object) -> pa.RecordBatch | None:
        """The part's columns, of one row; None where they are lost."""
        return (self._recorded if isinstance(version, tuple) else self._tape).value(part, version)

    def any_of_each_part(self) -> dict[Part, object]:
        return {**self._recorded.any_of_each_part(), **self._tape.any_of_each_part()}

    def close(self) -> None:
        """It reads as empty from now on."""
        self._tape.close()
        self._recorded.close()


AnyTape = Tape | StoredTape | BegunTape
