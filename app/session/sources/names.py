"""What sources are called."""

from __future__ import annotations

from pathlib import PurePath

from ispom.sequences.address import is_address, is_device


def run_name(source: str) -> str:
    """What an address calls a source: of a path the last part."""
    if source.startswith("sim:") or is_device(source) or is_address(source):
        return source
    return PurePath(source).name or source
