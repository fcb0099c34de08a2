"""What a published folder holds, read back."""

from __future__ import annotations

import gzip
import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ispom_app.views.rerun.rrd import HEADER
from rerun.chunk import Chunk, RrdReader


def content(path: Path) -> bytes:
    """Of a file, unpacked where it is compressed."""
    found = path.read_bytes()
    return gzip.decompress(found) if path.suffix == ".bin" else found


def data(site: Path, name: str) -> Any:
    return json.loads(content(site / "data" / f"{name}.bin"))


def pieces(packed: bytes) -> Iterator[bytes]:
    """The `.rrd` streams of a stage."""
    rest = gzip.decompress(packed)
    while rest:
        size = int.from_bytes(rest[:4], "big")
        yield rest[4 : 4 + size]
        rest = rest[4 + size :]


def chunks(packed: bytes, folder: Path) -> list[Chunk]:
    """What the pieces of a stage hold, as Rerun reads it."""
    joined = folder / "joined.rrd"
    joined.write_bytes(HEADER + b"".join(piece[len(HEADER) :] for piece in pieces(packed)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has no index
        return list(RrdReader(joined).stream().to_chunks())
