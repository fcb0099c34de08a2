"""Programs that the command line names as methods: `--external NAME[:KINDS]=COMMAND`."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterable, Iterator
from itertools import pairwise
from keyword import iskeyword

from ispom.errors import InputError
from ispom.estimators.program.estimator import ProgramConfig, program_method
from ispom.io.values import RESERVED, is_name
from ispom.methods import GROUPS, add, names
from ispom.types import Kind

FLAG = "--external"


def add_programs(words: list[str]) -> str:
    """Adds the programs that the command line names to the methods. Returns one sentence about the first mistake in
    them, or an empty text."""
    try:
        for value in _values(words):
            add(program_method(*_named(value)))
    except InputError as error:
        return str(error)
    return ""


def _values(words: Iterable[str]) -> Iterator[str]:
    for word, following in pairwise([*words, ""]):
        if word == FLAG:
            yield following
        elif word.startswith(f"{FLAG}="):
            yield word.removeprefix(f"{FLAG}=")


def _named(value: str) -> tuple[type[ProgramConfig], list[Kind]]:
    """Returns the settings of the program, and the kinds of frames at which it steps."""
    names_it, equals, command = value.partition("=")
    name, colon, kinds = names_it.partition(":")
    needs = kinds.split("+") if colon else ["video"]
    if not equals or len(set(needs)) < len(needs) or not set(needs) <= {"video", "stereo"}:
        raise InputError(
            f"{FLAG} is {value[:60]!r}: give NAME=COMMAND, or NAME:KINDS=COMMAND with video or stereo in KINDS"
        )
    if not is_name(name) or iskeyword(name):
        raise InputError(f"{FLAG} names a method {name[:60]!r}: use small letters, digits and _, a letter first")
    if name in RESERVED or name in GROUPS:
        raise InputError(f"{FLAG} names a method {name!r}, which has another meaning: choose another name")
    if name in {other.replace(".", "_").replace("-", "_") for other in names()}:
        raise InputError(f"{FLAG} names a method {name!r}, which there is already: choose another name")
    return type(name, (ProgramConfig,), {"name": name, "command": _split(name, command)}), needs  # type: ignore[return-value]


def _split(name: str, command: str) -> tuple[str, ...]:
    try:
        words = tuple(shlex.split(command))
    except ValueError as error:
        raise InputError(f"{FLAG} {name} has the command {command[:60]!r} ({error}): close its quotes") from None
    if not words or shutil.which(words[0]) is None:
        what = repr(words[0]) if words else "nothing"
        raise InputError(f"{FLAG} {name} starts {what}, which is no program: give its path, or one that is in PATH")
    return words
