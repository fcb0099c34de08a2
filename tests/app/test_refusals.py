"""Below a limit of the address space that is too small, each command says so in one sentence."""

from __future__ import annotations

import subprocess
import sys

import pytest
from ispom_app.cli import refusals

resource = pytest.importorskip("resource")
SMALL = 512_000_000
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds a process to its limit")


@pytest.mark.parametrize(
    "words", [[], ["--help"], ["run", "sim:tiny"], ["app", "sim:tiny"], ["run", "--help"], ["diff"]]
)
def test_it_is_one_sentence(words: list[str]) -> None:
    start = f"import resource, os, sys; resource.setrlimit(resource.RLIMIT_AS, ({SMALL}, {SMALL})); "
    start += "os.execv(sys.executable, [sys.executable, '-P', '-m', 'ispom_app', *sys.argv[1:]])"
    done = subprocess.run([sys.executable, "-c", start, *words], capture_output=True, text=True, check=False)
    (sentence,) = done.stderr.splitlines()
    assert done.returncode == 2 and sentence.startswith("ispom: ") and "0.5 GB" in sentence and not done.stdout


@pytest.mark.parametrize(
    ("limit", "words", "refused"),
    [
        (None, ["run"], False),
        (2_000_000_000, ["--help"], False),
        (2_000_000_000, ["run", "--help"], False),
        (2_000_000_000, ["diff", "a", "b"], False),
        (2_000_000_000, ["run", "sim:tiny"], True),
        (2_000_000_000, [], True),
        (5_000_000_000, ["run", "sim:tiny"], False),
    ],
)
def test_what_runs_estimators_takes_more(
    monkeypatch: pytest.MonkeyPatch, limit: int | None, words: list[str], refused: bool
) -> None:
    monkeypatch.setattr(refusals, "_limit", lambda: limit)
    assert (refusals.too_little(words) is not None) == refused
