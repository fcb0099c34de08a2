"""The command `ispom` and its subcommands, from demo to bench."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from typing import Annotated

import tyro

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.methods import faults

from .bench.options import Bench
from .calibrate.options import Calibrate, PrintTarget
from .experiment.options import Experiment
from .map.options import Map
from .options import App, Demo, Diff, Evaluate, Export, Fork, Learn, Perturb, Repair, Report, Run, Sources
from .run.playback import Builder
from .run.signals import INTERRUPTED

Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[App, tyro.conf.subcommand("app")]
    | Annotated[Learn, tyro.conf.subcommand("learn")]
    | Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Experiment, tyro.conf.subcommand("experiment")]
    | Annotated[Fork, tyro.conf.subcommand("fork")]
    | Annotated[Diff, tyro.conf.subcommand("diff")]
    | Annotated[Sources, tyro.conf.subcommand("sources")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[PrintTarget, tyro.conf.subcommand("target")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Map, tyro.conf.subcommand("map")]
    | Annotated[Perturb, tyro.conf.subcommand("perturb")]
    | Annotated[Repair, tyro.conf.subcommand("repair")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
)
MISUSE, BROKEN_PIPE = 2, 141
"""Exit codes; those after signals as shells give them."""


def main(arguments: Sequence[str] | None = None, builder: Builder = build) -> int:
    """Runs a command, with estimators from `builder`, and returns its exit code: 2 after a mistake of the user, told in
    one sentence."""
    description = "Visual odometry estimators (monocular, stereo, integrated), compared side by side in a browser."
    description += " --version prints which version this is."
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        if list(arguments) == ["--version"]:
            sys.stdout.write(f"ispom {version('ispom')}\n")
            sys.stdout.flush()
            return 0
        try:
            command = tyro.cli(Command, prog="ispom", description=description, args=arguments)  # type: ignore[arg-type]
        finally:
            sys.stdout.flush()  # of a help text, here, where a reader that left is no fault
        for fault in faults():
            sys.stderr.write(f"ispom: {fault}\n")
        code = _execute(command, arguments, builder)
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


def _execute(command: Command, arguments: Sequence[str], builder: Builder) -> int:
    """Imports late: the help text should not wait for viewers and ray casters."""
    if isinstance(command, Run):
        from .headless.command import run

        return run(command, builder)
    if isinstance(command, Experiment):
        from .experiment.command import experiment

        return experiment(command, builder)
    if isinstance(command, Fork):
        from .fork import fork

        return fork(command, arguments[1:], builder)
    if isinstance(command, Diff):
        from .diff.command import diff

        return diff(command)
    if isinstance(command, Sources):
        from .sources import print_description

        return print_description(command.open(command.source))
    if isinstance(command, Calibrate):
        from .calibrate.command import calibrate

        return calibrate(command)
    if isinstance(command, PrintTarget):
        from .calibrate.target import print_target

        return print_target(command)
    if isinstance(command, Evaluate):
        from .evaluate.command import evaluate

        return evaluate(command)
    if isinstance(command, Export):
        from .export import export

        return export(command)
    if isinstance(command, Map):
        from .map.command import make_map

        return make_map(command)
    if isinstance(command, Perturb):
        from .perturb import perturb

        return perturb(command, builder)
    if isinstance(command, Repair):
        from .repair import repair

        return repair(command)
    if isinstance(command, Report):
        from .report.command import report

        return report(command)
    if isinstance(command, Bench):
        from .bench.command import bench

        return bench(command)
    from .page.command import open_page

    return open_page(command, builder)


if __name__ == "__main__":
    sys.exit(main())
