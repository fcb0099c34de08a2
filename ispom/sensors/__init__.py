"""The kinds of sensors besides cameras, a module each: one that has a `KIND` is found by being here.

A module has all of its kind: the values in the rig and in the stream, how a table is read, what is likely a mistake,
the simulation, and how `fused` uses it (`SensorKind`). A package adds a kind by an entry point, a notebook by
`ispom.register`.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module

from ispom.registry import Registry
from ispom.sensors.kind import SensorKind


def _built_in() -> list[SensorKind]:
    modules = [import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return sorted((module.KIND for module in modules if hasattr(module, "KIND")), key=lambda kind: kind.order)


SENSOR_KINDS = Registry("ispom.sensors", SensorKind, "kind of sensor", _built_in())
"""Entry points of this group name a SensorKind."""
