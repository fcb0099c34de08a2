"""What two runs were asked to do differently."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ...engine.run_folder.run_file import RunFile

WRITTEN = ("recording", "methods")
"""Options that say what is written, not what is computed."""


@dataclass(frozen=True)
class Setting:
    """One that is not the same; None where a run has none of this name."""

    name: str
    a: Any
    b: Any


def differing(a: RunFile, b: RunFile, methods: tuple[str, ...]) -> list[Setting]:
    """Source, options, images, settings of these methods, and versions."""
    left, right = _flat(a, methods), _flat(b, methods)
    pairs = ((name, left.get(name), right.get(name)) for name in dict.fromkeys((*left, *right)))
    return [Setting(name, x, y) for name, x, y in pairs if x != y]


def _flat(run: RunFile, methods: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {"source": run.source, "sequence": run.sequence}
    found |= {name: value for name, value in run.options.items() if name not in WRITTEN}
    found["images_sha256"] = run.images_sha256
    for method in methods:
        found |= dict(_leaves(method, run.config.get(method)))
    return {**found, **dict(_leaves("versions", run.versions)), "platform": run.platform}


def _leaves(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        yield prefix, value
        return
    for name, inner in value.items():
        yield from _leaves(f"{prefix}.{name}", inner)
