"""Compiling ahead: in another process, waited for by simulations only, and not at all where it was done before."""

from __future__ import annotations

import subprocess
import sys

import pytest
from ispom_app import warmup

from ispom.sequences.simulated import compile_renderer
from tests import doubles


def test_what_was_compiled_before_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "compiled_before", lambda: True)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a process was started"))
    assert warmup.compiling_ahead(doubles.sequence) is doubles.sequence


def test_a_simulation_waits_for_the_compiler_and_a_failed_one_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []
    real = subprocess.Popen

    def popen(command: list[str], **options) -> subprocess.Popen[bytes]:
        assert command == [sys.executable, "-c", warmup.COMPILE]
        started.append(real([sys.executable, "-c", "raise SystemExit(3)"], **options))
        return started[0]

    monkeypatch.setattr(warmup, "compiled_before", lambda: False)
    monkeypatch.setattr(subprocess, "Popen", popen)
    opener = warmup.compiling_ahead(lambda source: doubles.sequence(int(source.removeprefix("sim:"))))
    assert len(opener("sim:5").times_ns) > 0 and started[0].returncode == 3


def test_the_command_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    rendered: list[tuple] = []
    monkeypatch.setattr("ispom.sequences.simulated._Source.render", lambda self, *what: rendered.append(what))
    compile_renderer()
    assert rendered == [(0, "video", 1)] and warmup.COMPILE.endswith(f"{compile_renderer.__name__}()")
