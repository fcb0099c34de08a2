"""The bytes of one run for the viewers in browsers. They are on disk, and readers can begin anywhere."""

from __future__ import annotations

import tempfile
import threading
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

import pyarrow as pa
from platformdirs import user_cache_path

from ispom.types import Kind

from .parts import CLEAR, IMAGE, Overlay, Part, Scene, archetype_of, camera_of, components_of, latest_of_each_camera

IMAGE_BYTES = 1 << 30
"""Memory on disk for images. The oldest ones are discarded and read from the sequence again; all other data stay."""


@dataclass(frozen=True)
class _Piece:
    """The file and position of some bytes."""

    file: BinaryIO
    offset: int
    size: int


@dataclass
class _Values:
    """The values of one part, by the frames from which on they hold."""

    frames: list[int] = field(default_factory=list)
    pieces: list[_Piece] = field(default_factory=list)

    def put(self, frame: int, piece: _Piece) -> None:
        at = bisect_left(self.frames, frame)
        if at < len(self.frames) and self.frames[at] == frame:
            self.pieces[at] = piece
        else:
            self.frames.insert(at, frame)
            self.pieces.insert(at, piece)


class Tape:
    """The tape of one run, to which frames are only appended. Its files have no name, so they vanish with the process.

    A viewer gets its opening, and then the parts of the frame that it shows.
    """

    def __init__(
        self,
        folder: Path | None = None,
        image_bytes: int = IMAGE_BYTES,
        *,
        recording_id: str = "",
        kinds: Callable[[], Sequence[Kind]] = tuple,
        expected: Callable[[], int] = lambda: 0,
        request: Callable[[int], None] = lambda _: None,
    ) -> None:
        """`kinds` returns the kinds of the frames, `expected` the number of frames that are known already, and
        `request` requests the images of a frame. OSError where `folder` (by default the user's cache) cannot be
        written."""
        self.run, self.recording_id = uuid4().hex, recording_id
        self.overlay = Overlay()
        self._kinds, self._expected, self._request = kinds, expected, request
        self._folder = folder or user_cache_path("ispom")
        self._folder.mkdir(parents=True, exist_ok=True)
        self._lock = threading.Lock()
        self._values_file = self._file()
        self._halves: deque[BinaryIO] = deque([self._file()], maxlen=2)
        self._half_bytes = image_bytes // 2
        self._opening = b""
        self._parts: dict[Part, _Values] = {}
        self._clears: dict[str, list[int]] = {}
        """By path, the frames from which on it has no values."""
        self._bare = set[int]()
        """Frames whose images have not come yet."""
        self._end = 0

    def open(self, opening: bytes) -> None:
        """`.rrd` messages with the layout and what holds for the whole run."""
        self._opening = opening

    def opening(self) -> bytes:
        return self._opening

    def put(self, frame: int, path: str, columns: pa.RecordBatch) -> None:
        """Adds values of a part of a frame, in place of any that it has. OSError where the disk is full."""
        archetype = archetype_of(columns)
        with self._lock:
            if archetype == CLEAR:
                self._clears.setdefault(path, []).append(frame)
                return
            content = _packed(components_of(columns, archetype))
            if archetype != IMAGE:
                piece = _write(self._values_file, content)
            else:
                if self._halves[-1].seek(0, 2) + len(content) > self._half_bytes:
                    if len(self._halves) == 2:
                        self._halves[0].close()
                    self._halves.append(self._file())
                piece = _write(self._halves[-1], content)
            self._parts.setdefault((path, archetype), _Values()).put(frame, piece)

    def came(self, frame: int, *, bare: bool = False) -> None:
        """Must be called when all parts of a frame, and of all frames before, were put. `bare`: its image comes
        later."""
        with self._lock:
            (self._bare.add if bare else self._bare.discard)(frame)
            self._end = max(self._end, frame + 1)

    @property
    def end(self) -> int:
        """Frames that can be shown so far."""
        return self._end

    @property
    def expected(self) -> int:
        """Frames that will be there in a moment."""
        return max(self._expected(), self._end)

    def scene(self, index: int) -> Scene:
        """What is to be shown of a frame."""
        cameras = latest_of_each_camera(self._kinds(), index)
        with self._lock:
            versions: dict[Part, _Piece] = {}
            for part, values in self._parts.items():
                at = bisect_right(values.frames, index) - 1
                if at >= 0 and self._holds(part, values.frames[at], index, cameras):
                    versions[part] = values.pieces[at]
            lost = [part for part, piece in versions.items() if piece.file.closed]
            missing = any(frame in self._bare for frame in cameras.values())
        return Scene(index, {p: v for p, v in versions.items() if p not in lost}, missing or bool(lost))

    def _holds(self, part: Part, frame: int, index: int, cameras: Mapping[str, int]) -> bool:
        """Returns whether the value of a frame is shown at a later one."""
        path, _ = part
        if (camera := camera_of(path)) is not None and frame != cameras.get(camera):
            return False
        clears = self._clears.get(path, [])
        return not any(frame <= cleared <= index for cleared in clears[bisect_left(clears, frame) :][:1])

    def request(self, index: int) -> None:
        """Asks for the images that a frame misses."""
        for frame in set(latest_of_each_camera(self._kinds(), index).values()):
            self._request(frame)

    def value(self, part: Part, version: object) -> pa.RecordBatch | None:
        """The part's columns, of one row; None where they are lost."""
        if not isinstance(version, _Piece):
            raise TypeError(f"a tape has no value of the version {version!r}: take versions from its scenes")
        with self._lock:
            content = _read(version)
        return pa.ipc.open_stream(content).read_next_batch() if content else None

    def any_of_each_part(self) -> dict[Part, _Piece]:
        with self._lock:
            return {part: values.pieces[-1] for part, values in self._parts.items()}

    def close(self) -> None:
        """Gives its space on the disk back; it reads as empty from now on."""
        with self._lock:
            self._opening = b""
            self._parts.clear()
            for file in (self._values_file, *self._halves):
                file.close()

    def _file(self) -> BinaryIO:
        return tempfile.TemporaryFile(dir=self._folder, prefix="live-")  # type: ignore[return-value]


def _packed(columns: pa.RecordBatch) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, columns.schema) as stream:
        stream.write_batch(columns)
    return sink.getvalue().to_pybytes()


def _write(file: BinaryIO, content: bytes) -> _Piece:
    offset = file.seek(0, 2)
    file.write(content)
    file.flush()
    return _Piece(file, offset, len(content))


def _read(piece: _Piece) -> bytes:
    if piece.file.closed:
        return b""
    piece.file.seek(piece.offset)
    return piece.file.read(piece.size)
