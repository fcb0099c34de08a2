"""What a recording holds, read back."""

from __future__ import annotations

from pathlib import Path

from rerun.chunk import RrdReader


def exposures_in(path: Path) -> set[int]:
    found: set[int] = set()
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if "exposure" in batch.schema.names:
            found |= set(batch.column("exposure").to_pylist())
    return found


def entities_in(path: Path) -> set[str]:
    batches = (chunk.to_record_batch() for chunk in RrdReader(path).stream().to_chunks())
    return {batch.schema.metadata[b"rerun:entity_path"].decode() for batch in batches}
