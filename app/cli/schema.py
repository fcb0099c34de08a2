"""`ispom schema`: what a command writes as JSON."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import tyro

from ispom.errors import InputError

from ..engine.outputs import schema_of
from .commands import COMMANDS


@dataclass(frozen=True, kw_only=True)
class Schema:
    """Prints the JSON schema of what a command writes as JSON: judge, evaluate, doctor, triage, shrink, undecided,
    budget, loops or passport."""

    command: tyro.conf.Positional[str]
    """Name of the command."""


def schema(options: Schema) -> int:
    """Prints it. Raises InputError for a command that has none."""
    known = {name: command for name, command in COMMANDS.items().items() if command.writes is not None}
    if options.command not in known:
        raise InputError(f"no schema belongs to {options.command[:60]!r}: give one of {', '.join(known)}")
    kind = known[options.command].written()
    assert kind is not None
    sys.stdout.write(schema_of(kind))
    return 0
