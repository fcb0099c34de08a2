"""What sources are called."""

from __future__ import annotations

from pathlib import Path, PurePath

from ispom.errors import is_text
from ispom.sequences.address import is_address, is_device, without_secrets

from ...engine.user_files import read_json, write_json


def run_name(source: str) -> str:
    """What an address calls a source: of a path the last part."""
    if source.startswith("sim:") or is_device(source) or is_address(source):
        return source
    return PurePath(source).name or source


MOST = 10


class RecentSources:
    """In a file of the user's own; without one (None), they are forgotten at the end."""

    def __init__(self, path: Path | None) -> None:
        self._path, found = path, read_json(path)
        names = found if isinstance(found, list) else ()
        self.names = tuple(n for n in names if isinstance(n, str) and is_text(n))[:MOST]
        """Newest first, without passwords."""

    def add(self, source: str) -> tuple[str, ...]:
        """Puts a source first. Where the file cannot be written, it is only not kept."""
        name = without_secrets(source)
        self.names = (name, *(n for n in self.names if n != name))[:MOST]
        write_json(self._path, self.names, "recent sources are")
        return self.names
