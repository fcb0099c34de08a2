"""run.yaml: what is needed to repeat a run, and to know that it was on the same images."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import yaml

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.mapping import read_mapping
from ispom.methods import names
from ispom.types import Frame, Sequence

from .run_folder import RUN

FRAMES: tuple[Frame, ...] = ("rig", "left", "video")
"""Whose poses a run may write."""
PACKAGES = ("ispom", "numpy", "scipy", "opencv-python-headless", "numba", "embreex", "rerun-sdk")
_NEEDED = {"source": str, "sequence": str, "notes": list, "options": dict, "config": dict, "versions": dict}


@dataclass(frozen=True)
class RunFile:
    """Plain values, lists of them, and mappings of those."""

    source: str
    sequence: str
    """Its name."""
    options: Mapping[str, Any]
    """Those of `ispom run`."""
    config: Mapping[str, Any]
    """By method: every setting."""
    notes: list[str] = field(default_factory=list)
    exposures: Mapping[str, int] = field(default_factory=dict)
    """Given, by kind: video, stereo."""
    images_sha256: str | None = None
    """Of all images that the estimators saw; None where the run did not come to its end."""
    versions: Mapping[str, str] = field(default_factory=dict)
    platform: str = ""

    @property
    def frame(self) -> Frame:
        """Whose poses the run's trajectories hold."""
        return self.options["frame"]

    @property
    def methods(self) -> tuple[str, ...]:
        """Those of the run that this installation knows."""
        asked = self.options.get("methods")
        return tuple(name for name in names() if isinstance(asked, list) and name in asked)

    @property
    def text(self) -> str:
        """The file's content."""
        return yaml.safe_dump(asdict(self), sort_keys=False, allow_unicode=True)


def run_file(
    source: str,
    sequence: Sequence,
    options: Mapping[str, Any],
    config: Mapping[str, Any],
    images_sha256: str | None = None,
) -> RunFile:
    """Of a run on this machine, with these versions."""
    return RunFile(
        source,
        sequence.name,
        dict(options),
        dict(config),
        list(sequence.notes),
        {kind: sequence.kinds.count(kind) for kind in ("video", "stereo")},
        images_sha256,
        {"python": platform.python_version(), **_versions()},
        platform.platform(),
    )


def _versions() -> dict[str, str]:
    """Of the packages that are here; the ray caster has no wheels for some machines."""
    found = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def read_run_file(folder: Path) -> RunFile:
    """InputError where the folder holds no run, or its run.yaml is not as written. Nothing in it is trusted."""
    path = folder / RUN
    if not exists(path):
        raise InputError(f"{folder} holds no run (no {RUN}): give a folder that `ispom run` wrote")
    found = read_mapping(path)
    for name, kind in _NEEDED.items():
        if not isinstance(found.get(name), kind):
            raise InputError(f"{path} has no {name} as `ispom run` writes it: restore the file, or run again")
    _require_plain(path, found, 0)
    frame = found["options"].setdefault("frame", "rig")
    if frame not in FRAMES:
        raise InputError(f"{path}: the frame is {str(frame)[:40]!r}, not one of {', '.join(FRAMES)}")
    exposures, images, machine = found.get("exposures"), found.get("images_sha256"), found.get("platform")
    return RunFile(
        **{name: found[name] for name in _NEEDED},
        exposures=exposures if isinstance(exposures, dict) else {},
        images_sha256=images if isinstance(images, str) else None,
        platform=machine if isinstance(machine, str) else "",
    )


def _require_plain(path: Path, value: Any, depth: int) -> None:
    """Refuses nests, for YAML's aliases can make a small file a huge page, and names that are no text."""
    inner = [*value.values(), *value.keys()] if isinstance(value, dict) else value if isinstance(value, list) else []
    if depth > 4 or len(inner) > 500:
        raise InputError(f"{path} holds more than a run's settings: restore the file, or run again")
    if isinstance(value, dict) and not all(isinstance(key, str) for key in value):
        raise InputError(f"{path} has names that are no text: restore the file, or run again")
    for item in inner:
        _require_plain(path, item, depth + 1)
