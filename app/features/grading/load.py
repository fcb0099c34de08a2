"""The methods of a package: a folder with pyproject.toml, an installed package, or a method by its name."""

from __future__ import annotations

import sys
import tomllib
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from ispom.errors import InputError
from ispom.estimator import Method
from ispom.io.files import exists, expanded, is_folder
from ispom.io.rows import read_text
from ispom.methods import REGISTRY, add, names

GROUP, PROJECT = REGISTRY.group, "pyproject.toml"


def methods_of(package: str, chosen: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the names of a package's methods, which are in the registry from now on. Raises InputError where there
    are none, or none of a chosen name."""
    found = _found(package)
    if unknown := [name for name in chosen if name not in found]:
        raise InputError(f"{package} has no method {unknown[0]!r}: choose from {', '.join(found)}")
    return tuple(name for name in found if not chosen or name in chosen)


def _found(package: str) -> tuple[str, ...]:
    folder = expanded(package)
    if exists(folder) and is_folder(folder):
        return _of_folder(folder)
    if package in names():
        return (package,)
    try:
        points = [point.name for point in distribution(package).entry_points if point.group == GROUP]
    except (PackageNotFoundError, ValueError):
        raise InputError(f"{package} is no folder, no installed package and no method: correct the name") from None
    if not points:
        raise InputError(f"{package} has no entry point of the group {GROUP}: add one to its {PROJECT}")
    if missing := [name for name in points if name not in names()]:
        raise InputError(f"{package}: the method {missing[0]!r} cannot be loaded: start `ispom run --help` to see why")
    return tuple(points)


def _of_folder(folder: Path) -> tuple[str, ...]:
    """Imports the methods that a folder's pyproject.toml names, installed or not."""
    project = folder / PROJECT
    if not exists(project):
        raise InputError(f"{folder} has no {PROJECT}: give the folder of a package, such as `ispom new-method` writes")
    try:
        points = tomllib.loads(read_text(project)).get("project", {}).get("entry-points", {}).get(GROUP, {})
    except (tomllib.TOMLDecodeError, AttributeError):
        raise InputError(f"{project} is not valid TOML: correct it") from None
    if not isinstance(points, dict) or not points:
        raise InputError(f'{project} has no entry point of the group {GROUP}: add [project.entry-points."{GROUP}"]')
    for place in (folder / "src", folder):
        if exists(place) and str(place.resolve()) not in sys.path:
            sys.path.insert(0, str(place.resolve()))
    return tuple(_loaded(project, str(value)) for value in points.values())


def _loaded(project: Path, value: str) -> str:
    module, _, attribute = value.partition(":")
    try:
        loaded = getattr(import_module(module.strip()), attribute.strip())
        found = loaded if isinstance(loaded, Method) else loaded()
    except Exception as fault:
        raise InputError(f"{project}: {value} fails with {type(fault).__name__}: {fault}") from fault
    if not isinstance(found, Method):
        raise InputError(f"{project}: {value} gives no ispom.Method: correct the entry point")
    if found.name not in names():
        add(found)
    return found.name
