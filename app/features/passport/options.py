"""Options of `ispom passport`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...engine.options import MovedSource, Programs


@dataclass(frozen=True, kw_only=True)
class Passport(Programs, MovedSource):
    """Writes a folder by which others repeat and cite a run: hashes of its files and poses, settings, versions, and
    figures. With --verify, checks the files of such a folder, repeats its run, and says whether the bytes are the same.

    The exit code is 0 where the folder was written or the bytes are the same, 1 where they differ, 2 for a mistake in
    what you gave, other files included, and 3 where it cannot tell."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` or `ispom fork` wrote. With --verify: a folder that this command wrote."""
    to: Path = Path("passport")
    """Folder to write: new, empty, or an earlier passport."""
    verify: bool = False
    """Only check a passport."""
    camera: Path | None = None
    """With --verify: where the file that the run had as --camera is now, if it is not in the source."""
    sensors: Path | None = None
    """With --verify: the same for --sensors."""
