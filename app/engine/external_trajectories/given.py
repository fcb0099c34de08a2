"""Trajectories of other programs as the command line names them: `--beside NAME[:FRAME]=FILE`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from ispom.errors import InputError
from ispom.evaluation.ate import Alignment
from ispom.io.files import expanded
from ispom.io.trajectories import TrajectoryFile, read_trajectory
from ispom.methods import names

FLAG, ALIGNMENT_FLAG = "--beside", "--beside-alignment"
BesideFrame = Literal["rig", "left", "right", "video"]
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
RESERVED = frozenset({"truth"})


@dataclass(frozen=True, eq=False)
class Given:
    """A trajectory file of another program, as it is: in a world, and maybe a unit, of its own."""

    name: str
    file: TrajectoryFile
    frame: BesideFrame = "rig"
    """Whose poses the file holds."""
    alignment: Alignment = "se3"


def given(values: Iterable[str], alignments: Iterable[str]) -> tuple[Given, ...]:
    """Those that the flags name, their files read. InputError for a mistake in a flag or a file."""
    found: dict[str, Given] = {}
    taken = {name.lower() for name in (*names(), *RESERVED)}
    for value in values:
        name, frame, path = _named(value)
        if name.lower() in taken:
            used = any(other.lower() == name.lower() for other in found)
            what = "another trajectory" if used else "a method" if name.lower() not in RESERVED else "the ground truth"
            raise InputError(f"{FLAG} names a trajectory {name!r}, as {what} is called: choose another name")
        taken.add(name.lower())
        found[name] = Given(name, read_trajectory(expanded(path)), frame)
    for value in alignments:
        name, _, kind = value.partition("=")
        if kind not in get_args(Alignment):
            kinds = ", ".join(get_args(Alignment))
            raise InputError(f"{ALIGNMENT_FLAG} is {value[:60]!r}: give NAME=ALIGNMENT with one of {kinds}")
        if name not in found:
            raise InputError(f"{ALIGNMENT_FLAG} is for {name[:40]!r}, which no {FLAG} names: give the name of one")
        found[name] = replace(found[name], alignment=kind)  # type: ignore[arg-type]
    return tuple(found.values())


def _named(value: str) -> tuple[str, BesideFrame, Path]:
    whose, equals, path = value.partition("=")
    name, colon, frame = whose.partition(":")
    frame = frame if colon else "rig"
    if not equals or not path or frame not in get_args(BesideFrame):
        frames = ", ".join(get_args(BesideFrame))
        raise InputError(f"{FLAG} is {value[:60]!r}: give NAME=FILE, or NAME:FRAME=FILE with one of {frames}")
    if not _NAME.fullmatch(name):
        raise InputError(f"{FLAG} names a trajectory {name[:60]!r}: use letters, digits, - and _, a letter first")
    return name, frame, Path(path)  # type: ignore[return-value]
