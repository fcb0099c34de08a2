"""Rendering in another process: the same bytes, and no process that dies takes a run with it."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np
import psutil
import pytest

from ispom.errors import InputError
from ispom.simulation.rendering.process import RenderPool, RenderProcess
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
    psutil.Process(first.pid).kill()
    assert first.wait(20)
    assert process.render(0, False, 0.1, 0, "video", 1).shape == (48, 64, 3)
    assert process.start() is process.start() is not first


def test_an_idle_process_gives_its_memory_back_and_comes_again() -> None:
    process = RenderProcess(idle_s=1.0)
    first = process.start()
    assert first.wait(60) and first.succeeded
    assert process.render(0, False, 0.1, 0, "video", 1).shape == (48, 64, 3)
    assert process.start() is not first
    process.stop()


def test_what_it_cannot_render_is_an_error_and_it_goes_on(process: RenderProcess) -> None:
    with pytest.raises(RuntimeError, match="rendering failed"):
        process.render(0, False, 0.1, 0, "infrared", 1)  # type: ignore[arg-type]
    assert process.render(0, False, 0.1, 0, "video", 1).shape == (48, 64, 3)


@pytest.mark.parametrize("at", ["reading", "half a head", "half an image"])
def test_one_that_dies_at_any_moment_each_time_is_reported_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    answer = {"reading": "", "half a head": "[48, 6", "half an image": "[48, 64, 3]\\n1234"}[at]
    script = (
        f"import os, sys; sys.stdin.readline(); sys.stdout.write('{answer}'); sys.stdout.flush()\n"
        "sys.stderr.write('libX.so.1: cannot open shared object file\\n'); sys.stderr.flush(); os.kill(os.getpid(), 9)"
    )
    monkeypatch.setattr("ispom.simulation.rendering.process._COMMAND", [sys.executable, "-c", script])
    with pytest.raises(InputError, match=r"renders .* was ended by SIGKILL \(libX\.so\.1: .*\), twice: ") as caught:
        RenderProcess().render(0, False, 0.1, 0, "video", 1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("command", "how"), [(["no-such-program"], "cannot be started"), ([sys.executable, "-c", ""], "exit code 0")]
)
def test_one_that_does_not_get_ready_is_reported_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, command: list[str], how: str
) -> None:
    monkeypatch.setattr("ispom.simulation.rendering.process._COMMAND", command)
    pool = RenderPool()
    pool.start()
    with pytest.raises(InputError, match=how):
        pool.render(0, False, 0.1, 0, "video", 1)


def test_it_ends_with_whoever_started_it_in_the_middle_of_an_image() -> None:
    """SIGKILL gives nobody the time to end it."""
    script = (
        "import os; from ispom.simulation.rendering.process import RenderProcess\n"
        "process = RenderProcess(); process.render(0, False, 0.1, 0, 'video', 1); child = process.start()\n"
        "child.requests.write(b'[0, true, 4.0, 0, \"stereo\", 1]\\n'); child.requests.flush()\n"  # a minute's work
        "print(child.pid, flush=True); os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    with suppress(psutil.NoSuchProcess):
        psutil.Process(int(done.stdout)).wait(10)


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
