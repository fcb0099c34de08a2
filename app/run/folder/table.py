"""Tables that grow row by row while a run goes on."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import Any

from .run_folder import RunFolder


class GrowingTable:
    """A CSV file of a run. All rows are with the system when `add` returns: a killed process loses none of them.

    Where the disk takes no more, the file ends with a whole row, the run's folder says so, and the run goes on.
    """

    def __init__(self, folder: RunFolder, name: str, columns: Sequence[str]) -> None:
        self._folder, self._name, self._whole = folder, name, 0
        self._file = None
        try:
            self._file = folder.part(name).open("wb", buffering=0)
        except OSError as error:
            folder.missed(name, error)
        self.add([columns])

    def add(self, rows: Iterable[Sequence[Any]]) -> None:
        if self._file is None:
            return
        text = StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows(rows)
        piece = memoryview(text.getvalue().encode())
        try:
            while piece:
                piece = piece[self._file.write(piece) :]
            self._whole = self._file.tell()
        except OSError as error:
            self._folder.missed(self._name, error)
            with suppress(OSError), self._file:
                self._file.truncate(self._whole)
            self._file = None

    def close(self, keep: bool = True) -> None:
        """Gives the file its name, or removes it."""
        if self._file is not None:
            self._file.close()
            self._file = None
        try:
            if keep:
                self._folder.keep(self._name)
            else:
                self._folder.part(self._name).unlink(missing_ok=True)
        except OSError as error:
            self._folder.missed(self._name, error)


def read_table(path: Path) -> list[dict[str, str]]:
    """The whole rows of a table whose writer may have been killed; none where there is no such file."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
    rows = csv.DictReader(line for line in lines if line.endswith("\n"))
    return [row for row in rows if None not in row.values()]


def cut_to_rows(path: Path) -> None:
    """Takes away a last row that was not written to its end. OSError where that cannot be."""
    content = path.read_bytes()
    os.truncate(path, content.rfind(b"\n") + 1)
