"""Rendering in another process: the same bytes, and no process that dies takes a run with it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from ispom.simulation.process import RenderProcess
from ispom.simulation.source import Source


@pytest.fixture(scope="module")
def process() -> Iterator[RenderProcess]:
    process = RenderProcess()
    yield process
    process.stop()


def test_it_renders_what_is_rendered_here(process: RenderProcess) -> None:
    there = process.render(3, False, 0.1, 40_000_000, "stereo", 2)
    assert np.array_equal(there, Source(3, False, 0.1).render(40_000_000, "stereo", 1))


def test_one_that_was_killed_is_replaced(process: RenderProcess) -> None:
    first = process.start()
    first.kill()
    first.wait()
    assert process.render(0, False, 0.1, 0, "video", 1).shape == (48, 64, 3)
    assert process.start() is process.start() is not first


def test_what_it_cannot_render_is_an_error_and_it_goes_on(process: RenderProcess) -> None:
    with pytest.raises(RuntimeError, match="rendering failed"):
        process.render(0, False, 0.1, 0, "infrared", 1)  # type: ignore[arg-type]
    assert process.render(0, False, 0.1, 0, "video", 1).shape == (48, 64, 3)


def test_one_that_always_dies_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ispom.simulation.process._COMMAND", ["false"])
    with pytest.raises(RuntimeError, match="ended in the middle"):
        RenderProcess().render(0, False, 0.1, 0, "video", 1)
