"""What a notebook adds to ISPOM, for its own process: a method, a format, a kind of sensor, a camera model
or a front end."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ispom.errors import InputError

REGISTRIES = (
    "ispom.sensors:SENSOR_KINDS",
    "ispom.methods:REGISTRY",
    "ispom.sequences.format:FORMATS",
    "ispom.cameras:CAMERA_MODELS",
    "ispom.features.front_ends:REGISTRY",
)


def register(item: Any) -> None:
    """Adds a Method, Format, SensorKind, CameraModel or FrontEnd under its name, for this process.

    `ispom.run` and all else find it then. One that was registered before under that name is replaced, as when a cell
    runs again. Raises InputError where the name is that of a built-in value or of an installed package, and for
    anything else.
    """
    for place in REGISTRIES:
        module, name = place.split(":")
        registry = getattr(import_module(module), name)
        if registry.takes(item):
            return registry.add(item, replace=True)
    raise InputError(
        f"a {type(item).__name__} cannot be registered: give a Method, Format, SensorKind, CameraModel or FrontEnd"
    )
