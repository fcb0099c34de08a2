"""The exceptions that a user's input may cause: what, where, and what to do, in one sentence; and `required`, for
what only a wrong call leaves out."""

from __future__ import annotations

from typing import TypeVar

LONGEST = 1_000
"""Characters of a sentence; of a longer one the middle is not shown."""
T = TypeVar("T")


class InputError(Exception):
    """Something that the user gave cannot be used. The message is one sentence that names the place and the cure.

    What a sentence quotes (names, paths, words of a file) is shown on one line and without control characters,
    whatever it holds.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class UnreadableImage(InputError):
    """One image of a recording is missing or damaged; those around it may be whole."""


def printable(text: str) -> str:
    """The text on one line, of bounded length: what is not printable is shown as its escape (a new line as \\n)."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def as_text(name: object) -> str:
    """What can be encoded, of a name from the disk: bytes in it that are no UTF-8 are shown as escapes."""
    return str(name).encode(errors="backslashreplace").decode()


def is_text(name: object) -> bool:
    """Whether a name from the disk can be encoded, and so be sent to a page and come back."""
    return as_text(name) == str(name)


def counted(count: int, one: str, many: str = "") -> str:
    """So many of something, in words of a sentence: "1 frame", "2 frames"; `many` where that is not `one` and an s."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def required(value: T | None, missing: str) -> T:
    """Returns a value that callers must provide. Raises ValueError with the sentence `missing` if it is None."""
    if value is None:
        raise ValueError(missing)
    return value
