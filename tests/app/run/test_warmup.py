"""The first compilation goes on in other processes, what is asked for first, and is waited for."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.engine import warmup
from ispom_app.engine.events import Stepped
from ispom_app.engine.playback import Playback
from ispom_app.features.headless.console import compile_first
from ispom_app.session import commands as do

from ispom import compiled_code
from ispom.ensemble import build
from ispom.kernel_list import kernel_list, kernels_of
from ispom.methods import Config
from ispom.sequences import open_sequence
from tests.app import helpers

STEREO = (("stereo",), Config())
QUICK = ("flow",)
"""A method with two kernels, which take a second or two."""
ECHO = "import sys\nfor line in sys.stdin: print(line.strip(), flush=True)"


def python(script: str) -> list[str]:
    return [sys.executable, "-c", script]


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """An empty cache, for this process and those that it starts."""
    place = tmp_path / "cache" / "ispom" / "kernels" / compiled_code._version()
    place.mkdir(parents=True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled_code, "folder", lambda: place)
    compilation = warmup.Compilation()
    monkeypatch.setattr(warmup, "_compilation", compilation)
    yield place
    with compilation.changed:
        compilation.failures.append("the test is over")
        compilation.changed.notify_all()


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fresh: Path) -> Path:
    """Processes that compile nothing, but say so at once as soon as this file is there."""
    go = tmp_path / "go"
    wait = (
        "import os, sys, threading\nnever = threading.Event()\n"
        f"while not os.path.exists({str(go)!r}): never.wait(0.01)\n"
    )
    monkeypatch.setattr(warmup, "COMMAND", python(wait + ECHO))
    return go


def test_it_is_waited_for(held: Path) -> None:
    warmup.start(*STEREO)
    warmup.start(*STEREO)
    assert not warmup.finished(0.01) and not warmup.ready(*STEREO)
    held.touch()
    assert warmup.ready(*STEREO, 20) and warmup.finished() and warmup.failure() is None
    assert not compiled_code.missing(kernels_of(("stereo",)))


def test_what_is_asked_for_comes_first_and_the_longest_of_it_at_once(
    held: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warmup, "_cores", lambda: 2)
    warmup.start(warmup.DEFAULT, Config())
    found, quick = warmup._compilation, kernels_of(QUICK)
    helpers.wait_for(lambda: len(found.working) == 2, "one kernel in each process")
    seconds = sorted((each.seconds for each in kernel_list().values()), reverse=True)
    assert sorted((kernel_list()[name].seconds for name in found.working), reverse=True) == seconds[:2]
    warmup.start(QUICK, Config())
    assert set(found.waiting[: len(quick)]) == quick and set(found.waiting[len(quick) :]).isdisjoint(quick)
    assert not warmup.ready(QUICK, Config())
    held.touch()
    assert warmup.ready(QUICK, Config(), 20) and warmup.finished(20)
    assert found.done == kernels_of((*warmup.DEFAULT, *QUICK))


def test_all_cores_work_and_no_more_processes_than_kernels(held: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "_cores", lambda: 3)
    warmup.start(*STEREO)
    assert warmup._compilation.processes == 3
    held.touch()
    assert warmup.finished(20)
    helpers.wait_for(lambda: not warmup._compilation.processes, "their end")
    warmup.start(QUICK, Config())
    assert warmup._compilation.processes <= len(kernels_of(QUICK))
    assert warmup.finished(20)


def test_the_share_and_the_time_left_are_told(held: Path) -> None:
    assert warmup.message() == warmup.MESSAGE
    warmup.start(*STEREO)
    found = warmup._compilation
    whole = sum(kernel_list()[name].seconds for name in kernels_of(("stereo",)))
    assert warmup.message(*STEREO).startswith(f"{warmup.MESSAGE}: ")
    share, left_s = found.progress(None)
    assert share < 0.1 and 0.5 * whole / found.processes < left_s < 2 * whole / found.processes
    with found.changed:
        longest = max(found.waiting, key=lambda name: kernel_list()[name].seconds)
        found.waiting.remove(longest)
        found.done.add(longest)
    assert found.progress(None)[0] == pytest.approx(share + kernel_list()[longest].seconds / whole, abs=0.05)
    held.touch()
    assert warmup.finished(20) and warmup.message(*STEREO) == warmup.MESSAGE


@pytest.mark.parametrize(
    "command",
    [[sys.executable, "-c", "import sys; sys.exit('no room for LLVM')"], ["no-such-program"]],
    ids=["fails", "does not start"],
)
@pytest.mark.usefixtures("fresh")
def test_one_that_fails_is_over_reported_and_not_tried_again(
    monkeypatch: pytest.MonkeyPatch, command: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(warmup, "COMMAND", command)
    warmup.start(*STEREO)
    assert warmup.finished(20) and warmup.ready(*STEREO)
    assert ("no room for LLVM" if "-c" in command else "no-such-program") in (warmup.failure() or "")
    assert len(caplog.records) == 1
    helpers.wait_for(lambda: not warmup._compilation.processes, "the end of all")
    warmup.start(*STEREO)
    assert not warmup._compilation.processes and warmup.finished()


@pytest.mark.usefixtures("held")
def test_what_is_kept_is_not_compiled_again() -> None:
    compiled_code.mark_complete(kernels_of(("stereo",)))
    warmup.start(*STEREO)
    assert not warmup._compilation.processes and warmup.finished()


@pytest.mark.usefixtures("held")
def test_what_is_not_needed_is_not_compiled() -> None:
    warmup.start(("stereo.paper", "monocular.paper"), Config())
    assert not warmup._compilation.processes and warmup.ready(("stereo.paper",), Config())


def test_an_interrupted_compilation_keeps_what_is_done(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = "numerics.cholesky.solve_factored", "numerics.lie.logs"
    child = warmup.Child(warmup.COMMAND)
    try:
        child.requests.write(f"{first}\n".encode())
        child.requests.flush()
        assert child.answers.readline().decode().strip() == first
        child.requests.close()  # as where the app ends, however it does
        assert child.wait(20)
    finally:
        child.stop()
    assert compiled_code.kept((first, second)) == {first}
    assert compiled_code.missing((first, second)) == {first, second}  # nothing says that they are undamaged
    before = {path: path.stat().st_mtime_ns for path in fresh.rglob("*.nb?")}
    warmup._compilation.ask((first, second))
    assert warmup.finished(60) and warmup.failure() is None
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert compiled_code.kept((first, second)) == {first, second} and not compiled_code.missing((first, second))


@pytest.mark.usefixtures("fresh")
def test_a_first_start_runs_the_method_that_was_asked_for_and_nothing_before(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ready_before_a_step, step = list[bool](), Playback.step

    def watched(playback: Playback) -> Stepped:
        ready_before_a_step.append(not compiled_code.missing(kernels_of(QUICK)))
        return step(playback)

    monkeypatch.setattr(Playback, "step", watched)
    session = helpers.started(
        tmp_path,
        "sim:tiny",
        opener=lambda source, options=None: open_sequence(source, max_exposures=4),
        methods=QUICK,
        builder=build,
        compiling=warmup.start,
    )
    try:
        helpers.wait_for(lambda: session.state.computed == session.state.total > 0, "the end", 100.0)
        assert {step.method for record in session.history for step in record.steps} == set(QUICK)
        assert ready_before_a_step and all(ready_before_a_step)
        assert compiled_code.kept(kernels_of(QUICK)) == kernels_of(QUICK)
    finally:
        session.close(20.0)


def test_a_command_says_once_that_it_compiles(held: Path, capsys: pytest.CaptureFixture[str]) -> None:
    threading.Timer(0.2, held.touch).start()
    compile_first(*STEREO)
    assert warmup.finished()
    out, errors = capsys.readouterr()
    assert not out and errors.count(warmup.MESSAGE) == 1
    compile_first(*STEREO)
    assert capsys.readouterr() == ("", "")


def test_the_page_says_so_and_goes_on_after_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    over = threading.Event()
    monkeypatch.setattr(warmup, "ready", lambda methods, config, wait_s=0.0: over.wait(wait_s))
    started_methods: list[tuple[str, ...]] = []
    session = helpers.started(tmp_path, compiling=lambda methods, config: started_methods.append(methods))
    try:
        helpers.wait_for(
            lambda: session.state.activity and warmup.MESSAGE in session.state.activity.text, "the message"
        )
        assert len(started_methods) == 1 and not session.history
        session.post(do.Play(False))
        helpers.wait_for(lambda: not session.state.playing, "a pause meanwhile")
        over.set()
        session.post(do.Play(True))
        helpers.wait_for(lambda: session.state.computed == session.state.total, "the end")
    finally:
        session.close(20.0)


@pytest.mark.usefixtures("fresh")
def test_the_page_reports_one_that_failed_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(warmup, "COMMAND", python("import sys; sys.exit('no room for LLVM')"))
    session = helpers.started(tmp_path, compiling=warmup.start)
    try:
        helpers.wait_for(lambda: session.state.notices, "the failure")
        helpers.wait_for(lambda: session.state.computed == session.state.total, "the end")
        assert [n.text for n in session.state.notices] == [warmup.failure()] and not session.state.compiling
        assert "compiled in advance" in (warmup.failure() or "")
    finally:
        session.close(20.0)
