"""Rendering in another process: the same bytes, and no process that dies takes a run with it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ispom.simulation.process import RenderPool, RenderProcess
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


def test_a_second_process_helps_once_the_first_has_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    both, used = threading.Barrier(2, timeout=10), []

    def render(self: RenderProcess, *what: object) -> np.ndarray:
        used.append(self)
        if len(used) > 1:
            both.wait()
        return np.zeros(1, np.uint8)

    monkeypatch.setattr(RenderProcess, "render", render)
    pool = RenderPool()
    with ThreadPoolExecutor(3) as threads:
        for future in [threads.submit(pool.render, 0, False, 1.0, i, "video", 1) for i in range(3)]:
            future.result()
    assert used[0] in used[1:] and len(set(used)) == 2
