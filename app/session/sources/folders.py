"""The folders in which somebody at the page may look for recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ispom.sequences import recognised

MOST = 200
"""Entries that are listed of a folder."""


@dataclass(frozen=True)
class Entry:
    """A folder or file in a folder."""

    path: Path
    source: bool
    """Whether it can be opened as it is; else it is a folder to look into."""


@dataclass(frozen=True)
class Folders:
    """Below `root` only, links followed; None: anywhere, beginning where the app was started."""

    root: Path | None = None

    @property
    def home(self) -> Path:
        return (self.root or Path.cwd()).resolve()

    def above(self, folder: Path) -> Path | None:
        """The folder that holds this one; None where nobody may look there."""
        return folder.parent if folder != folder.parent and self._allowed(folder.parent) else None

    def entries(self, folder: Path) -> list[Entry]:
        """What can be opened or looked into, by name; nothing of a folder that may not be read."""
        found: list[Entry] = []
        if not self._allowed(folder):
            return found
        try:
            for path in sorted(folder.iterdir()):
                if path.name.startswith(".") or not self._allowed(path) or len(found) == MOST:
                    continue
                if (known := recognised(path)) or path.is_dir():
                    found.append(Entry(path, known))
        except OSError:
            pass  # as far as it could be read
        return found

    def _allowed(self, path: Path) -> bool:
        return self.root is None or path.resolve().is_relative_to(self.root.resolve())
