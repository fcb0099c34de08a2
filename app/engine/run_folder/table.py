"""Tables that grow row by row while a run goes on."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import Any, BinaryIO

from ispom.errors import InputError
from ispom.io.files import exists, opened, require_file
from ispom.io.whole import create_file

from .run_folder import RunFolder

LONGEST_LINE = 1 << 20
"""Most bytes of a row: a row with 500 checks is far below."""


class GrowingTable:
    """A CSV file of a run. When `add` returns, the operating system has all rows: a killed process loses none.

    Where the disk is full, the file ends with a complete row, the run's folder says so, and the run continues.
    """

    def __init__(self, folder: RunFolder, name: str, columns: Sequence[str]) -> None:
        self._folder, self._name, self._whole = folder, name, 0
        self._file = None
        try:
            self._file = create_file(folder.part(name))
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
    """Returns the complete rows of a table whose writer may have been killed; none where there is no such file.

    Damaged rows are skipped. InputError where the path is no regular file, or cannot be read.
    """
    if not exists(path):
        return []
    with opened(path) as file:
        rows, found = csv.DictReader(_whole_lines(file)), list[dict[str, str]]()
        while True:
            with suppress(csv.Error):
                row = next(rows, None)
                if row is None:
                    return found
                if None not in row and None not in row.values():
                    found.append(row)


def _whole_lines(file: BinaryIO) -> Iterator[str]:
    """Yields lines up to the first incomplete one. A file without line breaks yields nothing, however large it is."""
    while (line := file.readline(LONGEST_LINE)).endswith(b"\n"):
        yield line.decode(errors="replace")


def cut_to_rows(path: Path) -> None:
    """Removes the last row if it is incomplete.

    InputError where the path is a link, or no table. OSError where the file cannot be changed.
    """
    if path.is_symlink():
        raise InputError(f"{path} is a link: remove it, and repair again")
    size = require_file(path)
    with path.open("r+b") as file:
        start = max(0, size - LONGEST_LINE)
        file.seek(start)
        end = start + file.read(LONGEST_LINE).rfind(b"\n") + 1
        if start and end == start:
            raise InputError(f"{path} is no table, for its last row has no end: remove it, and repair again")
        file.truncate(end)
