"""The frame of Rerun's `.rrd` streams, as far as it takes to join several into one: a viewer reads the first one only.

    stream = HEADER  message*  end          message = kind (8 bytes)  size (8 bytes)  content, little-endian

The end holds an index (two thirds of a small stream); a viewer that is fed piece by piece does without.
"""

from __future__ import annotations

import struct

import rerun as rr

_HEADER_BYTES = 12
_HEAD = struct.Struct("<QQ")
_END = 0


def messages(stream: bytes | None) -> bytes:
    """What is between a stream's header and its end; None is an empty stream."""
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
"""What every stream of this version begins with."""
