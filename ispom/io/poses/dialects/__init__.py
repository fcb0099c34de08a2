"""The dialects of poses, one module each: every module of this package that has a `DIALECT` is registered.

A module's docstring states the conventions of the program: axes, order of the quaternion, units, direction of the
poses, and their source. It is shown in the documentation.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.dialects import in_words, matching, modules_of
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile


@cache
def modules() -> dict[str, ModuleType]:
    """Returns the modules of this package by the names of their dialects, sorted by title."""
    return modules_of(__name__, __path__)


def dialects() -> tuple[PoseDialect, ...]:
    """Returns all dialects."""
    return tuple(module.DIALECT for module in modules().values())


def recognised(content: PoseContent) -> PoseDialect | None:
    """Returns the dialect of a file; None where it has no dialect's signature. Raises InputError where it has the
    signatures of two, as it would be read as the wrong one."""
    found = matching(dialects(), content)
    if len(found) > 1:
        raise InputError(
            f"{content.path} may be a file of {in_words(found)}: write the names of its columns as its first line, "
            "such as timestamp x y z qx qy qz qw"
        )
    return found[0] if found else None


def read(content: PoseContent, times_ns: NDArray[np.int64] | None = None) -> TrajectoryFile:
    """Reads a file by its dialect; `times_ns` are those of its rows, where it has none. Raises InputError for a file of
    no known dialect, with a list of the signatures."""
    dialect = recognised(content)
    if dialect is not None:
        return dialect.read(content, times_ns)
    if content.header_fault is not None:
        raise content.header_fault
    if content.is_text and not content.objects:
        _refuse_text(content)
    kinds = ("text", "JSON") if content.is_text else ("binary", "bag")
    looked = "; ".join(f"{each.title}: {each.looked_for}" for each in dialects() if each.kind in kinds)
    raise InputError(f"{content.path} has no poses in a known format. Looked for {looked}")


def _refuse_text(content: PoseContent) -> None:
    """Raises InputError for a file without rows, and for one with a number of columns that no dialect has."""
    if not content.data and not content.rows:
        raise InputError(f"{content.path} holds no pose: give a trajectory, such as a TUM, KITTI or EuRoC file")
    if content.sample:
        line = content.data[0][0] if content.data else content.rows[0][0]
        widths = "TUM (8), KITTI (12), EuRoC (8 or more, comma-separated), matrices (16), numbered matrices (13 or 17)"
        raise InputError(
            f"{content.path} line {line} has {content.width} columns, which no trajectory has: give a file of "
            f"{widths}, or a header that names the columns (timestamp, x, y, z, qx, qy, qz, qw)"
        )
