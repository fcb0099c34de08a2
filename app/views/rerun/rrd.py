"""The container format of Rerun's `.rrd` streams, as far as it is needed to join several streams into one, because a
viewer reads only the first.

    stream = HEADER  message*  end          message = kind (8 bytes)  size (8 bytes)  content, little-endian

The end has an index (two thirds of a small stream), which a viewer that is fed piece by piece does not need.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import rerun as rr

from ispom.errors import InputError
from ispom.io.files import read_head

_HEADER_BYTES = 12
MOST_BYTES = 1 << 30
"""Most bytes of a message; that of a 4K image has a hundredth of it."""
_HEAD = struct.Struct("<QQ")
_END, _DATA = 0, 2
_LAST = b"RRF2FOOT\x01\0\0\0"
"""The last bytes of an index; a stream that was not closed has none."""


def messages(stream: bytes | None) -> bytes:
    """Returns the messages between a stream's header and its end; `stream` None is an empty stream."""
    if not stream:
        return b""
    at = _HEADER_BYTES
    while at < len(stream):
        kind, size = _HEAD.unpack_from(stream, at)
        if kind == _END:
            break
        at += _HEAD.size + size
    return stream[_HEADER_BYTES:at]


def _header() -> bytes:
    recording = rr.RecordingStream("header")
    stream = rr.binary_stream(recording)
    recording.log("nothing", rr.Clear(recursive=False))
    return (stream.read() or b"")[:_HEADER_BYTES]


HEADER = _header()
"""The first bytes of every stream of this version."""


def require_readable(path: Path) -> None:
    """InputError where the file is no finished recording of the Rerun version that is installed."""
    begins = read_head(path, len(HEADER))
    if begins[:4] != HEADER[:4] or len(begins) < len(HEADER):
        raise InputError(f"{path} is no Rerun recording: give a .rrd file")
    written, own = (f"{stream[4]}.{stream[5]}" for stream in (begins, HEADER))
    if written != own:
        raise InputError(
            f"{path} was written by Rerun {written}, and the viewer here is {own}: open it with Rerun's own"
        )
    try:
        finished = is_finished(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions") from None
    if not finished:
        raise InputError(f"{path} has no index, for its writer was stopped: finish it with `ispom repair`")


def whole_bytes(path: Path) -> int:
    """Length of the file's whole messages; 0 where it is no stream. OSError where it cannot be read.

    An end without an index does not count: zeros look like one, and a sparse file may have a terabyte of them.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(HEADER)) != HEADER:
            return 0
        at = _HEADER_BYTES
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            kind, content = _HEAD.unpack(head)
            after = at + _HEAD.size + content
            if kind == _END and is_finished(path):
                return size
            if kind == _END or after > size or content > MOST_BYTES:
                break
            at = after
            file.seek(at)
    return at


def is_finished(path: Path) -> bool:
    """Whether the file has its end, the index, which a recording gets when it is closed. OSError where unreadable."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - len(_LAST)))
        return file.read() == _LAST


def message_starts(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """(place, kind) of each message, and at last the place where they end, of kind 0."""
    at, size = _HEADER_BYTES, file.seek(0, 2)
    while at < size:
        file.seek(at)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            break
        kind, content = _HEAD.unpack(head)
        if kind == _END:
            break
        yield at, kind
        at += _HEAD.size + content
    yield at, _END


def chunk_at(file: BinaryIO, start: int) -> pa.RecordBatch:
    """The chunk of data in the message that begins there."""
    file.seek(start)
    _, size = _HEAD.unpack(file.read(_HEAD.size))
    fields = _fields(file.read(size))
    content = fields[_PAYLOAD]
    if fields.get(_COMPRESSION) == _LZ4:
        content = pa.decompress(content, decompressed_size=fields[_WHOLE_BYTES], codec="lz4_raw")
    return pa.ipc.open_stream(content).read_next_batch()


def uncompressed(content: bytes) -> bytes:
    """Returns the messages of a stream (from `messages`) with uncompressed Arrow data, for a file that is compressed as
    a whole."""
    found, at = list[bytes](), 0
    while at < len(content):
        kind, size = _HEAD.unpack_from(content, at)
        message = content[at + _HEAD.size : at + _HEAD.size + size]
        at += _HEAD.size + size
        if kind == _DATA and (fields := _fields(message)).get(_COMPRESSION) == _LZ4:
            payload = pa.decompress(
                fields[_PAYLOAD], decompressed_size=fields[_WHOLE_BYTES], codec="lz4_raw"
            ).to_pybytes()
            fields |= {_COMPRESSION: _NONE, _WHOLE_BYTES: len(payload), _PAYLOAD: payload}
            message = b"".join(_field(number, value) for number, value in fields.items())
        found.append(_HEAD.pack(kind, len(message)) + message)
    return b"".join(found)


_COMPRESSION, _WHOLE_BYTES, _PAYLOAD = 2, 3, 5
"""Fields of `ArrowMsg`, as in log_msg.proto of Rerun 0.41."""
_NONE, _LZ4 = 1, 2


def _fields(message: bytes) -> dict[int, Any]:
    """The values of a protobuf message by field number, as they are in it."""
    found: dict[int, Any] = {}
    at = 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = message[at]
            at, value, shift = at + 1, value | (byte & 127) << shift, shift + 7
            if byte < 128:
                return value

    while at < len(message):
        key = number()
        if key & 7 == 0:
            found[key >> 3] = number()
        else:
            length = number() if key & 7 == 2 else 8 if key & 7 == 1 else 4
            found[key >> 3] = message[at : at + length]
            at += length
    return found


def count_messages(path: Path) -> int:
    """How many chunks of data a file holds. OSError where it cannot be read."""
    with path.open("rb") as file:
        return sum(kind == _DATA for _, kind in message_starts(file))


def is_empty(path: Path) -> bool:
    """Whether the file is a stream that was stopped before its first data. OSError where it cannot be read."""
    with path.open("rb") as file:
        begins = file.read(len(HEADER))
    return HEADER.startswith(begins) and not count_messages(path)


def _field(number: int, value: int | bytes) -> bytes:
    """A field of a protobuf message: a number, or bytes."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])
