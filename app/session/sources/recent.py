"""The sources that were opened last, kept for the user between starts."""

from __future__ import annotations

import json
import logging
import os
import tempfile
from pathlib import Path

from ispom.sequences.address import without_secrets

log = logging.getLogger(__name__)
MOST = 10


class RecentSources:
    """In a file of the user's own; without one (None), they are forgotten at the end."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.names = _read(path)
        """Newest first, without passwords."""

    def add(self, source: str) -> tuple[str, ...]:
        """Puts a source first. Where the file cannot be written, it is only not kept."""
        name = without_secrets(source)
        self.names = (name, *(n for n in self.names if n != name))[:MOST]
        if self._path is not None:
            try:
                _write(self._path, self.names)
            except OSError as fault:
                log.warning("%s cannot be written (%s): recent sources are not kept", self._path, fault)
        return self.names


def _read(path: Path | None) -> tuple[str, ...]:
    """What the file has; nothing where it is missing or damaged."""
    try:
        found = json.loads(path.read_text("utf-8")) if path else []
    except (OSError, ValueError):
        return ()
    return tuple(n for n in found if isinstance(n, str))[:MOST] if isinstance(found, list) else ()


def _write(path: Path, names: tuple[str, ...]) -> None:
    """In one move: another app may do the same."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
        json.dump(names, file)
    os.replace(file.name, path)
