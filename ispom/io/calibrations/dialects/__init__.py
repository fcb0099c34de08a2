"""The dialects of calibrations, one module each: every module of this package that has a `DIALECT` is registered.

A module's docstring states the conventions of the program: pixel origin, order of the coefficients, direction of the
poses, units, and their source. It is shown in the documentation.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType

from ispom.errors import InputError
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect
from ispom.io.dialects import in_words, matching, modules_of


@cache
def modules() -> dict[str, ModuleType]:
    """Returns the modules of this package by the names of their dialects, sorted by title."""
    return modules_of(__name__, __path__)


def dialects() -> tuple[Dialect, ...]:
    """Returns all dialects."""
    return tuple(module.DIALECT for module in modules().values())


def recognised(content: Content) -> Dialect | None:
    """Returns the dialect of a file; None where it has no dialect's signature. Raises InputError where it has the
    signatures of two, as it would be read as the wrong one."""
    found = matching(dialects(), content)
    if len(found) > 1:
        raise InputError(f"{content.path} has the entries of {in_words(found)}: remove those of one")
    return found[0] if found else None


def read(content: Content, size: ImageSize | None = None) -> CalibrationFile:
    """Reads a file by its dialect; `size` is that of the images, used where it has none. Raises InputError for a file
    of no known dialect, with a list of the signatures."""
    dialect = recognised(content)
    if dialect is not None:
        return dialect.read(content, size)
    if content.suffix in (".yaml", ".yml", ".json") and content.fault is not None:
        raise content.fault
    kinds = _kinds(content)
    looked = "; ".join(f"{each.title}: {each.looked_for}" for each in dialects() if each.kind in kinds)
    raise InputError(f"{content.path} is no calibration that is known. Looked for in {' or '.join(kinds)}: {looked}")


def _kinds(content: Content) -> tuple[str, ...]:
    if content.text is None:
        return ("binary",)
    if content.text.lstrip().startswith("<"):
        return ("XML",)
    if content.values is not None and not isinstance(content.values, str | int | float):
        return ("JSON",) if content.text.lstrip()[:1] in ("{", "[") else ("YAML",)
    return ("text",)
