"""An app on the stand-in sequence, and waiting for what it says instead of for time to pass."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ispom_app.engine.options import SourceOptions
from ispom_app.session.session import Session

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
    session = Session(options.pop("opener", opener), source, folder, **({"builder": build} | options))
    session.start()
    return session
