"""run.yaml: the data that repeat a run, and that show whether it used the same images."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal, get_args

import yaml

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.mapping import MAX_BYTES, mapping_of
from ispom.io.rows import read_text
from ispom.methods import Config, in_order, method, names, with_dependencies
from ispom.settings import files_named, from_plain
from ispom.types import Sequence

from ..playback import Stage
from .own import is_signed, signed
from .run_folder import RUN

RunFrame = Literal["rig", "left", "video"]
"""Whose poses a run may write."""
FRAMES: tuple[RunFrame, ...] = get_args(RunFrame)
PACKAGES = ("ispom", "numpy", "scipy", "opencv-python-headless", "numba", "embreex", "open3d", "open3d-cpu")
PACKAGES += ("rerun-sdk",)
"""Whose versions may change numbers or files of a run. Open3D is called `open3d-cpu` where it has no GPU's code."""
_NEEDED = {"source": str, "sequence": str, "notes": list, "options": dict, "config": dict, "versions": dict}


@dataclass(frozen=True)
class RunFile:
    """The content of run.yaml: plain values, lists, and mappings."""

    source: str
    sequence: str
    """Its name."""
    options: Mapping[str, Any]
    """Those of `ispom run`."""
    config: Mapping[str, Any]
    """By method: every setting."""
    notes: list[str] = field(default_factory=list)
    exposures: Mapping[str, int] = field(default_factory=dict)
    """Number of frames by kind: video, stereo."""
    duration_s: float = 0.0
    """From the first of these frames to the last."""
    images_sha256: str | None = None
    """SHA-256 of all images that the estimators saw; None where the run did not reach its end."""
    versions: Mapping[str, str] = field(default_factory=dict)
    platform: str = ""
    processor: str = ""
    """Its model; empty where the run of an earlier version does not say."""
    forked: list[Mapping[str, Any]] = field(default_factory=list)
    """The stages before this run's settings, oldest first: {run, at, methods, config}; see `earlier`."""
    stopped: Mapping[str, Any] | None = None
    """Where --until stopped the run: `exposure`, `time_ns`, `values` by name; None where it did not stop it."""
    placements: list[Mapping[str, Any]] = field(default_factory=list)
    """Where in the shared world each method's own world is, from which frame on; see placements.py."""
    own: bool = False
    """Whether this program wrote the file on this machine, and nobody changed it since. It is not in the file."""

    @property
    def earlier(self) -> tuple[Stage, ...]:
        """Returns the runs from which this one was forked, up to their forks.

        InputError where that is not as `ispom fork` writes it.
        """
        return tuple(_stage(entry) for entry in self.forked)

    def configs(self) -> Config:
        """Returns the settings. InputError for an invalid one."""
        return _config(self.config, "config")

    def files_named(self) -> dict[str, str]:
        """The files and folders that its settings, and those before a fork, name, by `METHOD.SETTING`; of methods that
        this installation knows."""
        found, known = dict[str, str](), names()
        for config in (*(entry.get("config") for entry in self.forked), self.config):
            given = config.items() if isinstance(config, Mapping) else ()
            for name, values in given:
                if name in known and isinstance(values, Mapping):
                    named = files_named(method(name).config, values)
                    found |= {f"{name}.{setting}": file for setting, file in named.items()}
        return found

    @property
    def frame(self) -> RunFrame:
        """Whose poses the run's trajectories hold."""
        return self.options["frame"]

    @property
    def methods(self) -> tuple[str, ...]:
        """Returns the run's methods, without those that this installation does not have."""
        listed = self.options.get("methods")
        return tuple(name for name in names() if isinstance(listed, list) and name in listed)

    @property
    def text(self) -> str:
        """The file's content, signed by this machine."""
        values = asdict(self)
        del values["own"]
        return signed(yaml.safe_dump(values, sort_keys=False, allow_unicode=True))


def run_file(
    source: str,
    sequence: Sequence,
    options: Mapping[str, Any],
    config: Mapping[str, Any],
    images_sha256: str | None = None,
    forked: Iterable[Mapping[str, Any]] = (),
    stopped: Mapping[str, Any] | None = None,
    placements: Iterable[Mapping[str, Any]] = (),
) -> RunFile:
    """Returns the run.yaml of a run on this machine, with the versions of its packages."""
    times_ns = sequence.times_ns
    return RunFile(
        source,
        sequence.name,
        dict(options),
        dict(config),
        list(map(str, sequence.notes)),
        {"video": 0, "stereo": 0, **Counter(sequence.kinds)},
        round(float(times_ns[-1] - times_ns[0]) * 1e-9, 3) if len(times_ns) else 0.0,
        images_sha256,
        {"python": platform.python_version(), **versions()},
        platform.platform(),
        processor(),
        list(forked),
        stopped,
        list(placements),
    )


def fork_entry(run: str, stage: Stage) -> dict[str, Any]:
    """Returns the entry about `run` in the file of its fork, which is the same up to the end of the stage. Frame `at`
    counts from 0."""
    config = {name: asdict(stage.config.of(name)) for name in with_dependencies(stage.methods)}
    return {"run": run, "at": stage.until, "methods": list(stage.methods), "config": config}


def _stage(entry: Mapping[str, Any]) -> Stage:
    at, methods = entry.get("at"), entry.get("methods")
    if not isinstance(at, int) or at < 0 or not isinstance(methods, list) or not methods:
        raise InputError(f"{RUN} says of a fork {str(entry)[:60]!r}: restore the file, or run again")
    return Stage(at, in_order(str(name) for name in methods), _config(entry.get("config"), "forked.config"))


def _config(plain: Any, where: str) -> Config:
    if not isinstance(plain, dict):
        raise InputError(f"{RUN}: {where} holds no settings: restore the file, or run again")
    return Config({name: from_plain(method(name).config, values, f"{where}.{name}") for name, values in plain.items()})


def versions() -> dict[str, str]:
    """Returns the versions of the installed packages; some machines have no wheel of the ray caster."""
    found = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def processor() -> str:
    """The model of this machine's processor, on which rounding may depend; its kind where the system names no model."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            name, _, model = line.partition(":")
            if name.strip() == "model name":
                return model.strip()
    return platform.processor() or platform.machine()


def read_run_file(folder: Path) -> RunFile:
    """InputError where the folder holds no run, or its run.yaml is not as written. Nothing in it is trusted."""
    path = folder / RUN
    if not exists(path):
        raise InputError(f"{folder} holds no run (no {RUN}): give a folder that `ispom run` wrote")
    text = read_text(path, MAX_BYTES)
    found = mapping_of(path, text)
    for name, kind in _NEEDED.items():
        if not isinstance(found.get(name), kind):
            raise InputError(f"{path} has no {name} as `ispom run` writes it: restore the file, or run again")
    _require_plain(path, found, 0)
    frame = found["options"].setdefault("frame", "rig")
    if frame not in FRAMES:
        raise InputError(f"{path}: the frame is {str(frame)[:40]!r}, not one of {', '.join(FRAMES)}")
    forked = found.get("forked", [])
    if not isinstance(forked, list) or not all(isinstance(entry, dict) for entry in forked):
        raise InputError(f"{path} does not say what it was forked from as `ispom fork` writes it: restore the file")
    placements = found.get("placements", [])
    if not isinstance(placements, list) or not all(isinstance(entry, dict) for entry in placements):
        raise InputError(f"{path} has no placements as `ispom run` writes them: restore the file, or run again")
    stopped = found.get("stopped")
    if stopped is not None and not (isinstance(stopped, dict) and type(stopped.get("exposure")) is int):
        raise InputError(f"{path} does not say where the run was stopped as `ispom run` writes it: restore the file")
    exposures, images, duration_s = found.get("exposures"), found.get("images_sha256"), found.get("duration_s")
    return RunFile(
        **{name: found[name] for name in _NEEDED},
        exposures=exposures if isinstance(exposures, dict) else {},
        duration_s=float(duration_s) if isinstance(duration_s, int | float) else 0.0,
        images_sha256=images if isinstance(images, str) else None,
        platform=_text(found.get("platform")),
        processor=_text(found.get("processor")),
        forked=forked,
        stopped=stopped,
        placements=placements,
        own=is_signed(text),
    )


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _require_plain(path: Path, value: Any, depth: int) -> None:
    """Raises InputError for deep nesting, because YAML's aliases can make a small file huge, and for names that are no
    text."""
    inner = [*value.values(), *value.keys()] if isinstance(value, dict) else value if isinstance(value, list) else []
    if depth > 6 or len(inner) > 500:
        raise InputError(f"{path} holds more than a run's settings: restore the file, or run again")
    if isinstance(value, dict) and not all(isinstance(key, str) for key in value):
        raise InputError(f"{path} has names that are no text: restore the file, or run again")
    for item in inner:
        _require_plain(path, item, depth + 1)
