"""An app on the stand-in sequence, and waiting for what it says instead of for time to pass."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ispom_app.cli.main import main
from ispom_app.engine.options import SourceOptions
from ispom_app.engine.playback import Builder, Playback
from ispom_app.features.bookmarks.service import Bookmarks
from ispom_app.features.breakpoints.commands import Breakpoints
from ispom_app.features.layers.state import Layers
from ispom_app.features.lessons.state import Lessons
from ispom_app.features.plots.commands import Plots
from ispom_app.features.recording.state import Recordings
from ispom_app.features.sweep.sweep import SweepState
from ispom_app.features.tracks.commands import Inspection
from ispom_app.session.branches.state import Branches
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.external_paths import ExternalPaths
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.session.state import FeatureState, State

from ispom import ensemble
from ispom.ensemble import Ensemble
from ispom.methods import Config
from ispom.types import Rig, Sequence
from tests import doubles

MEMORY_BYTES = 10**9
"""Of a run's history: more than any run of the tests takes."""


def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Stands in for ispom.ensemble.build."""
    return doubles.ensemble(methods, doubles.FakeEstimator)


def build_full(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Stands in for ispom.ensemble.build, with estimators that say all that a Step can say."""
    return doubles.ensemble(methods, doubles.FullEstimator)


def opener(source: str, options: SourceOptions | None = None) -> Sequence:
    """`double:N` has N video frames."""
    return doubles.sequence(int(source.split(":")[1]))


def open_source(source: str, options: SourceOptions | None = None) -> Sequence:
    """Opens what a source names, no stand-in."""
    return (options or SourceOptions()).open(source)


def run_to_end(playback: Playback) -> CurrentRun:
    """A run over all exposures, whose whole history is kept in memory."""
    run = CurrentRun(playback, MEMORY_BYTES)
    while not run.done:
        run.step()
    return run


def ran(source: str | Path, out: Path, *options: str, builder: Builder = ensemble.build) -> Path:
    """The folder of a finished run that `ispom run` has written, in this process."""
    assert main(["run", str(source), *options, "--out", str(out)], builder) == 0
    return out


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


@contextmanager
def paused_session(folder: Path, source: str = "double:20", **options: Any) -> Iterator[Session]:
    """A session as `started` makes it, whose source is open and that does not play; it has to end in time."""
    session = started(folder, source, autoplay=False, **options)
    wait_for(lambda: session.state.phase == "ready", "opening")
    yield session
    assert session.close(5.0)


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


def files_of(folder: Path) -> dict[str, bytes]:
    """All files of a folder without folders, by their names."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}
