"""Formats of recordings that installed packages add (entry points `ispom.formats`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.registry import Registry
from ispom.sequences.recording import Recording
from ispom.types import Sequence


@dataclass(frozen=True, eq=False)
class Format:
    """How folders or files of a format are recognised and opened."""

    name: str
    """Name in messages."""
    recognises: Callable[[Path], bool]
    """Checks a folder, or a file with one of the `suffixes`. It is tried before folders of images and videos."""
    open: Callable[[Path], Sequence | Recording]
    """Opens it: a Sequence is run unchanged; a Recording is split into video and stereo frames by the options. Raises
    InputError with one sentence about the problem."""
    suffixes: frozenset[str] = frozenset()
    """Suffixes of files, in lower case with a dot; empty for a format of folders."""


FORMATS = Registry("ispom.formats", Format, "format", ())
"""Formats of installed packages."""


def format_of(path: Path, is_folder: bool) -> Format | None:
    """Returns the format of a package that recognises a folder or file; None where none does.

    Raises InputError where a package fails.
    """
    for each in FORMATS.items().values():
        if is_folder or path.suffix.lower() in each.suffixes:
            with _failing_as(each, path):
                if each.recognises(path):
                    return each
    return None


def opened(found: Format, path: Path) -> Sequence | Recording:
    """Opens a folder or file by the format. Raises InputError, also where the package fails."""
    with _failing_as(found, path):
        return found.open(path)


@contextmanager
def _failing_as(found: Format, path: Path) -> Iterator[None]:
    """Converts any exception of the package to an InputError."""
    try:
        yield
    except (InputError, OSError):
        raise
    except Exception as fault:
        raise InputError(f"{path}: format {found.name} fails with {type(fault).__name__}: {fault}") from fault
