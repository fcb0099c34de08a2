"""The command `ispom` and its subcommands."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from typing import Annotated, NoReturn, Union

import tyro

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.registry import faults

from ..engine.playback import Builder
from ..engine.signals import INTERRUPTED
from .commands import COMMANDS, MOVED

MISUSE, BROKEN_PIPE = 2, 141
"""Exit codes; those after signals as shells give them."""


def main(arguments: Sequence[str] | None = None, builder: Builder = build) -> int:
    """Runs a command, with estimators from `builder`, and returns its exit code: 2 after a mistake of the user,
    reported in one sentence."""
    arguments = list(sys.argv[1:] if arguments is None else arguments) or ["app"]
    try:
        if arguments == ["--version"]:
            sys.stdout.write(f"ispom {version('ispom')}\n")
            sys.stdout.flush()
            return 0
        try:
            name = arguments[0].replace("_", "-")
            if name in MOVED and name not in COMMANDS.names():
                raise InputError(f"`ispom {name}` is `{MOVED[name]}` now: write that instead")
            command = COMMANDS.get(name) if name in COMMANDS.names() else _none_of_them(arguments)
            options = command.read(arguments[1:])
        finally:
            sys.stdout.flush()  # of a help text, here, where a reader that left is no fault
        for fault in faults():
            sys.stderr.write(f"ispom: {fault}\n")
        code = command.execute(options, arguments[1:], builder)
        sys.stdout.flush()
        return code
    except InputError as error:
        return _misuse(str(error))
    except BrokenPipeError:
        _discard_output()
        return BROKEN_PIPE
    except OSError as error:  # a full disk, missing permissions: faults of the place, not of the program
        _discard_output()
        what, reason = error.filename or "standard output", error.strerror or str(error)
        return _misuse(printable(f"{what} cannot be used ({reason}): check the path, its permissions and free space"))
    except KeyboardInterrupt:
        return INTERRUPTED


def _none_of_them(arguments: Sequence[str]) -> NoReturn:
    """Prints the help of all commands, or what is wrong with the first word, and ends."""
    classes = {name: command.options_class() for name, command in COMMANDS.items().items() if command.listed}
    choices = tuple(Annotated[options, tyro.conf.subcommand(name)] for name, options in classes.items())
    description = "Visual odometry estimators (monocular, stereo, integrated), compared side by side in a browser."
    description += " --version prints which version this is."
    tyro.cli(Union[choices], prog="ispom", description=description, args=arguments)  # type: ignore # noqa: UP007
    raise AssertionError("a command was read that is not in the table")


def _misuse(sentence: str) -> int:
    with suppress(OSError):  # nobody reads it
        sys.stderr.write(f"ispom: {sentence}\n")
    return MISUSE


def _discard_output() -> None:
    """What is still in the buffer of a standard output that takes no more, so that Python's end is quiet."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
