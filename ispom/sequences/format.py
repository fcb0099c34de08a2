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
    """How a kind of folder or file is recognised and opened."""

    name: str
    """Its identity in messages."""
    recognises: Callable[[Path], bool]
    """Looks at a folder, or at a file with one of the `suffixes`. It is tried before folders of images and videos."""
    open: Callable[[Path], Sequence | Recording]
    """Opens it: a Sequence is run as it is, a Recording becomes video and stereo frames as the options say. Raises
    InputError with one sentence for what is wrong."""
    suffixes: frozenset[str] = frozenset()
    """Of files, in lower case with a dot; a format without any is one of folders."""


FORMATS = Registry("ispom.formats", Format, "format", ())
"""Those of installed packages."""


def format_of(path: Path, is_folder: bool) -> Format | None:
    """Returns the format of a package that recognises a folder or file; None where none does.

    Raises InputError where a package fails while it looks.
    """
    for each in FORMATS.items().values():
        if is_folder or path.suffix.lower() in each.suffixes:
            with _failing_as(each, path):
                if each.recognises(path):
                    return each
    return None


def opened(found: Format, path: Path) -> Sequence | Recording:
    """Returns what the format makes of a folder or file. Raises InputError where the package fails, too."""
    with _failing_as(found, path):
        return found.open(path)


@contextmanager
def _failing_as(found: Format, path: Path) -> Iterator[None]:
    """Any fault of the package as one sentence."""
    try:
        yield
    except (InputError, OSError):
        raise
    except Exception as fault:
        raise InputError(f"{path}: format {found.name} fails with {type(fault).__name__}: {fault}") from fault
