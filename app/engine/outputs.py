"""Files that a command writes where the user says. Its own earlier files are replaced; other files are never
changed."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import msgspec

from ispom.errors import InputError
from ispom.io.whole import write_whole

MARKER = ".written-by-ispom"
"""The file that marks a folder which a command may write again. `ispom run` uses INCOMPLETE until a run is complete."""
_HEAD_BYTES = 4096
MARK_BYTES = 64 << 10
"""Most bytes of a mark that are read: a file of somebody else may have any size."""


def write_file(path: Path, content: str | bytes, signature: str) -> None:
    """Makes the file, or replaces one that is of the same kind: `signature` stands within the beginning of its content.

    An empty file is replaced, too. InputError, and nothing changed, where there is something else, or the disk does not
    take it.
    """
    require_own(path, signature)
    write_whole(path, content)


def json_text(value: Any, indent: int) -> str:
    """Returns the content of a JSON file. Numbers that are not finite become null, as JSON has none."""
    finite = json.loads(json.dumps(value, default=float), parse_constant=lambda _: None)
    return json.dumps(finite, indent=indent, allow_nan=False) + "\n"


def json_of(value: msgspec.Struct) -> str:
    """The content of the JSON file that a command writes; `schema_of` its type describes it."""
    return json_text(msgspec.to_builtins(value, enc_hook=_number), 2)


def _number(value: Any) -> Any:
    """NumPy's numbers and booleans as Python's."""
    return value.item()


def schema_of(kind: type[msgspec.Struct]) -> str:
    """The JSON schema of such a file, as JSON."""
    return json.dumps(msgspec.json.schema(kind), indent=2) + "\n"


def csv_of(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """The content of a CSV file."""
    out = StringIO(newline="")
    csv.writer(out, lineterminator="\n").writerows([head, *rows])
    return out.getvalue()


def require_own(path: Path, signature: str) -> None:
    """InputError where there is something at the path that has no such signature."""
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder: give the name of a file")
        if not path.exists() and not path.is_symlink():
            return
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(_HEAD_BYTES)
            if not head or signature.encode() in head:
                return
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}): give another name") from None
    raise InputError(f"{path} exists and is no earlier output of this command: give another name, or remove it first")


def signature(command: str) -> str:
    """The line by which a folder's mark says which command the folder belongs to."""
    return f"Written by `ispom {command}`"


def is_signed(mark: Path, command: str) -> bool:
    """Whether this file is there, and says that its folder belongs to the command. OSError where unreadable."""
    return mark.is_file() and signature(command) in mark_text(mark)


def mark_text(mark: Path) -> str:
    """The beginning of a mark. OSError where it cannot be read."""
    with mark.open("rb") as file:
        return file.read(MARK_BYTES).decode(errors="replace")


def claim_folder(path: Path, command: str) -> None:
    """Makes the folder, or takes one that is empty or the same command's earlier output.

    InputError, and nothing changed, where it holds anything else or cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        mark = path / MARKER
        other = None
        if not is_signed(mark, command):
            other = next(iter(sorted(entry.name for entry in path.iterdir())), None)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path} cannot be created ({reason}): give another folder") from None
    if other is not None:
        raise InputError(f"{path} is not empty (it holds {other}): give a new or empty folder")
    write_whole(mark, f"{signature(command)}.\n")
