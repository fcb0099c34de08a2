"""The command `ispom` and its subcommands, from demo to bench."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from pkgutil import iter_modules
from types import ModuleType
from typing import Annotated, Union

import tyro

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.registry import faults

from ..engine.playback import Builder
from ..engine.signals import INTERRUPTED
from . import commands
from .call import Call

MISUSE, BROKEN_PIPE = 2, 141
"""Exit codes; those after signals as shells give them."""


def main(arguments: Sequence[str] | None = None, builder: Builder = build) -> int:
    """Runs a command, with estimators from `builder`, and returns its exit code: 2 after a mistake of the user,
    reported in one sentence."""
    description = "Visual odometry estimators (monocular, stereo, integrated), compared side by side in a browser."
    description += " --version prints which version this is."
    arguments = list(sys.argv[1:] if arguments is None else arguments) or ["app"]
    try:
        if arguments == ["--version"]:
            sys.stdout.write(f"ispom {version('ispom')}\n")
            sys.stdout.flush()
            return 0
        try:
            known = _commands()
            choices = tuple(Annotated[each.Options, tyro.conf.subcommand(name)] for name, each in known.items())
            options = tyro.cli(Union[choices], prog="ispom", description=description, args=arguments)  # type: ignore # noqa: UP007
        finally:
            sys.stdout.flush()  # of a help text, here, where a reader that left is no fault
        for fault in faults():
            sys.stderr.write(f"ispom: {fault}\n")
        command = next(each for each in known.values() if each.Options is type(options))
        code = command.execute(options, Call(builder, arguments[1:]))
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


def _commands() -> dict[str, ModuleType]:
    """The modules of the folder `commands` by name (`new-method` of new_method.py), in the order of their PLACE. They
    import their work late: the help text should not wait for viewers and ray casters."""
    names = [module.name for module in iter_modules(commands.__path__)]
    found = {name.replace("_", "-"): import_module(f"{commands.__name__}.{name}") for name in names}
    return dict(sorted(found.items(), key=lambda item: item[1].PLACE))


if __name__ == "__main__":
    sys.exit(main())
