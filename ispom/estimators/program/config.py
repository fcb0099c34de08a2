"""The settings of a method that is a program."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from ispom.settings import Range
from ispom.types import Rig

if TYPE_CHECKING:
    from ispom.estimators.program.estimator import Program


@dataclass(frozen=True)
class ProgramConfig:
    """Extended by each such method, with a name and command, and fields for the settings that the program takes."""

    name: ClassVar[str] = ""
    """Of the method."""
    command: ClassVar[tuple[str, ...]] = ()
    """The program and its arguments, started without a shell. No setting: neither a page nor a run folder says it."""

    timeout_s: Annotated[float, Range(10, 3600)] = 60.0
    """The program is ended where it takes longer to start or to answer about a frame [s]."""
    replay_mb: Annotated[int, Range(0, 100_000)] = 2000
    """Temporary disk space for the frames seen [MB], to go back in a run of a program that saves no state. Such a
    program sees them again from the start, so changed settings act from there; beyond this size, no going back."""

    def build(self, rig: Rig) -> Program:
        from ispom.estimators.program.estimator import Program

        return Program(self, rig)

    @property
    def of_program(self) -> dict[str, Any]:
        """The settings that the program is given."""
        own = {f.name for f in fields(ProgramConfig)}
        return {name: value for name, value in asdict(self).items() if name not in own}
