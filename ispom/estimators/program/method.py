"""Programs as methods."""

from __future__ import annotations

from collections.abc import Iterable

from ispom.errors import InputError
from ispom.estimator import Method
from ispom.estimators.program.config import ProgramConfig
from ispom.estimators.program.description import greeted
from ispom.estimators.program.estimator import explained
from ispom.estimators.program.pipe import Pipe, ProgramFault
from ispom.types import Kind


def program_method(config: type[ProgramConfig], sensors: Iterable[Kind]) -> Method:
    """The method of a program, which is started once to ask what it does; InputError where it does not say."""
    pipe = Pipe(config.command, config().timeout_s)
    try:
        found = greeted(pipe)
    except ProgramFault as fault:
        pipe.stop()
        raise InputError(explained(config, fault, "when it was greeted", pipe)) from None
    finally:
        pipe.stop()
    return Method(config.name, frozenset(sensors), config, found.unit, found.source, checks=found.checks)
