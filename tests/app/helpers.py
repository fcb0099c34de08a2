"""An app on the stand-in sequence, and waiting for what it says instead of for time to pass."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ispom_app.engine.options import SourceOptions
from ispom_app.features.bookmarks.service import Bookmarks
from ispom_app.features.breakpoints.commands import Breakpoints
from ispom_app.features.layers.state import Layers
from ispom_app.features.lessons.state import Lessons
from ispom_app.features.plots.commands import Plots
from ispom_app.features.recording.state import Recordings
from ispom_app.features.sweep.sweep import SweepState
from ispom_app.features.tracks.commands import Inspection
from ispom_app.session.branches.state import Branches
from ispom_app.session.external_paths import ExternalPaths
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.session.state import FeatureState, State

from ispom.ensemble import Ensemble
from ispom.methods import Config
from ispom.types import Rig
from tests import doubles


def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Stands in for ispom.ensemble.build."""
    return doubles.ensemble(methods, doubles.FakeEstimator)


def opener(source: str, options: SourceOptions | None = None):
    """`double:N` has N video frames."""
    return doubles.sequence(int(source.split(":")[1]))


def wait_for(condition: Callable[[], object], what: str, timeout_s: float = 20.0) -> None:
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, f"timed out waiting for {what}"
        time.sleep(0.005)


def started(folder: Path, source: str = "double:20", **options) -> Session:
    """A session on stand-ins, unless `options` say otherwise."""
    live = options.pop("live", None)
    setup = SessionSetup(options.pop("opener", opener), source, folder, **({"builder": build} | options))
    session = Session(setup, live)
    session.start()
    return session


def with_values(state: State, **values: Any) -> State:
    """A state with other values: of its core, or of its features by the names that follow."""
    kinds: dict[str, tuple[type[FeatureState], str]] = {
        "branches": (Branches, "all"),
        "branch": (Branches, "shown"),
        "comparison": (Branches, "comparison"),
        "external": (ExternalPaths, "all"),
        "external_errors": (ExternalPaths, "errors"),
        "plots": (Plots, "names"),
        "sweep": (SweepState, "sweep"),
        "lesson": (Lessons, "now"),
        "marked": (Breakpoints, "marked"),
        "bookmarks": (Bookmarks, "marks"),
        "recording": (Recordings, "current"),
        "colour_by": (Layers, "colour_by"),
        "hidden": (Layers, "hidden"),
        "chosen": (Layers, "chosen"),
        "look": (Inspection, "panel"),
        "selected": (Inspection, "selected"),
    }
    for name in values.keys() & kinds.keys():
        kind, field = kinds[name]
        state = state.having(replace(state[kind], **{field: values.pop(name)}))
    return replace(state, **values)
