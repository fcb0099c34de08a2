"""Names of sources, recently opened sources, and folders in which a person can look for others."""

from __future__ import annotations

from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePath

from ispom.errors import InputError, is_text
from ispom.io.files import bounded, inside, is_folder, names
from ispom.sequences import recognised
from ispom.sequences.address import is_address, is_device, without_secrets

from ...engine.user_files import read_json, write_json


def run_name(source: str) -> str:
    """Returns the name of a source in an address; for a path, its last part."""
    if source.startswith("sim:") or is_device(source) or is_address(source):
        return source
    return PurePath(source).name or source


MOST = 10


class RecentSources:
    """Sources that were opened recently, in a file of the user. Without a file (None) they are forgotten at the end."""

    def __init__(self, path: Path | None) -> None:
        self._path, found = path, read_json(path)
        names = found if isinstance(found, list) else ()
        self.names = tuple(n for n in names if isinstance(n, str) and is_text(n))[:MOST]
        """Newest first, without passwords."""

    def add(self, source: str) -> tuple[str, ...]:
        """Puts a source first. If the file cannot be written, the source is forgotten at the end."""
        name = without_secrets(source)
        self.names = (name, *(n for n in self.names if n != name))[:MOST]
        write_json(self._path, self.names, "recent sources are")
        return self.names


MOST = 200
"""Most entries that are listed of a folder."""


@dataclass(frozen=True)
class Entry:
    """A folder or file in a folder."""

    path: Path
    source: bool
    """Whether it can be opened as a source; otherwise it is a folder to look into."""


@dataclass(frozen=True)
class Folders:
    """Folders at or below `root`, with links resolved. None: all folders, beginning where the app was started."""

    root: Path | None = None

    @property
    def home(self) -> Path:
        """Returns the first folder to look into. InputError where it is gone."""
        try:
            return (self.root or Path.cwd()).resolve()
        except FileNotFoundError:
            raise InputError("the folder that this was started in is gone: start it in another") from None

    def above(self, folder: Path) -> Path | None:
        """Returns the parent of a folder; None where nobody may look there."""
        return folder.parent if folder != folder.parent and self._allowed(folder.parent) else None

    def entries(self, folder: Path) -> list[Entry]:
        """Returns the entries of a folder that can be opened or looked into, ordered by name. Names that a page cannot
        show are skipped. Empty for a folder that may not be read."""
        found: list[Entry] = []
        with self._bounded(), suppress(InputError):
            for path in (folder / name for name in names(folder) if not name.startswith(".")):
                if len(found) == MOST:
                    break
                if is_text(path) and ((known := recognised(path)) or _may_be_entered(path)):
                    found.append(Entry(path, known))
        return found

    def _allowed(self, path: Path) -> bool:
        with self._bounded():
            return inside(path)

    def _bounded(self) -> AbstractContextManager[None]:
        return bounded(None if self.root is None else (self.root,))


def _may_be_entered(path: Path) -> bool:
    """Returns whether the path is a folder that can be read."""
    try:
        return is_folder(path)
    except InputError:
        return False
