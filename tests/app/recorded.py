"""What a recording holds, read back."""

from __future__ import annotations

from pathlib import Path

from rerun.chunk import RrdReader


def exposures_in(path: Path) -> set[int]:
    batches = (chunk.to_record_batch() for chunk in RrdReader(path).stream().to_chunks())
    return {i for batch in batches if "exposure" in batch.schema.names for i in batch.column("exposure").to_pylist()}


def entities_in(path: Path) -> set[str]:
    batches = (chunk.to_record_batch() for chunk in RrdReader(path).stream().to_chunks())
    return {batch.schema.metadata[b"rerun:entity_path"].decode() for batch in batches}
