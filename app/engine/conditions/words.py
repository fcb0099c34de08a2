"""An expression's text as words, each with its place."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from ispom.errors import InputError

LONGEST = 4_000
"""Characters of an expression."""
LARGEST = 1e15
RESERVED = ("and", "or", "not", "abs", "changed", "increased")
_PATTERN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z0-9_]+)*)"
    r"|(?P<text>\"[^\"\n]*\"|'[^'\n]*')"
    r"|(?P<sign><=|>=|==|!=|[<>+\-*/()])"
)


@dataclass(frozen=True)
class Word:
    kind: Literal["number", "name", "text", "sign", "end"]
    text: str
    column: int
    """Counted from 1."""

    def __str__(self) -> str:
        return "the end" if self.kind == "end" else self.text if len(self.text) <= 60 else f"{self.text[:60]}…"


def mistake(column: int, what: str) -> InputError:
    """One sentence that names the place."""
    return InputError(f"column {column} of the expression: {what}")


def words(text: str, known: Collection[str] = ()) -> list[Word]:
    """Its words, and the end; InputError at the first character that starts none.

    `known` are names that a name's pattern may not match whole, as where a method's name has a hyphen.
    """
    if len(text) > LONGEST:
        raise mistake(LONGEST + 1, f"it has {len(text)} characters: give at most {LONGEST}")
    unusual = [name for name in known if not re.fullmatch(r"[\w.]+", name, re.ASCII)]
    found, at = [], 0
    while at < len(text):
        whole = max((name for name in unusual if text.startswith(name, at)), key=len, default=None)
        word = _PATTERN.match(text, at)
        if whole is not None:
            found.append(Word("name", whole, at + 1))
            at += len(whole)
            continue
        if word is None:
            raise mistake(at + 1, _stranger(text[at]))
        if word.lastgroup == "number":
            _require_plain(text, word)
        if word.lastgroup != "space":
            found.append(Word(word.lastgroup, word.group(), at + 1))  # type: ignore[arg-type]
        at = word.end()
    return [*found, Word("end", "", len(text) + 1)]


def _require_plain(text: str, word: re.Match[str]) -> None:
    """A number ends where its digits do, and is of a size that is measured."""
    following = text[word.end() : word.end() + 1]
    if following == "." or following == "_" or following.isalpha():
        raise mistake(word.start() + 1, f"{word.group()[:30]}{following} is no number: numbers have no unit, names do")
    if float(word.group()) > LARGEST:
        raise mistake(word.start() + 1, f"{word.group()[:30]} is too large: give at most {LARGEST:g}")


def _stranger(character: str) -> str:
    if character in "\"'":
        return "the text that begins here has no end: close its quotation mark"
    if character == "=":
        return "= compares nothing: write =="
    if character in "&|":
        return f"{character} is no sign: write {'and' if character == '&' else 'or'}"
    if character == "!":
        return "! is no sign: write not, or !="
    return f"{character!r} cannot stand here: use names, numbers, texts and + - * / ( ) < <= > >= == !="
