"""The methods of the paper's survey (Tables 1 to 3), a module each: one that has a `METHOD` is found by being here.

A `METHOD` is a Method, or a function without arguments that returns one.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module

from ispom.estimator import Method


def found() -> tuple[Method, ...]:
    """Returns the methods of this package, sorted by name."""
    modules = [import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    declared = [module.METHOD for module in modules if hasattr(module, "METHOD")]
    methods = [each if isinstance(each, Method) else each() for each in declared]
    return tuple(sorted(methods, key=lambda method: method.name))
