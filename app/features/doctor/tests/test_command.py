"""`ispom doctor`: of a run's folder, its answer and file; a mistake is one sentence, and Ctrl-C ends it at once."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.features.doctor import command
from ispom_app.features.doctor.job import examine

from ispom.evaluation.doctor.suspects import SUSPECTS
from tests.app.written import breaks_schema

FRAMES = 33


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("doctor") / "run"
    source = ["run", "sim:tiny?fault=darkness", "--methods", "stereo", "--max-exposures", str(FRAMES)]
    assert main([*source, "--no-recording", "--out", str(out)]) == 0
    return out


def test_the_answer_is_printed_and_the_file_has_every_suspect(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["doctor", str(run), "--at", "20", "--frames", "16", "--out", str(out)]) == 0
    assert not breaks_schema("doctor", (out / "doctor.json").read_text())
    found = json.loads((out / "doctor.json").read_text())
    assert found["at"] == 20 and found["first"] < 20 < found["last"] and found["causes"][0] == "darkness"
    keys = [row["key"] for row in found["ranked"]] + found["silent"] + found["left"]
    assert sorted(keys) == sorted(suspect.key for suspect in SUSPECTS)
    assert found["ranked"][0]["found"] and found["ranked"][0]["strength"] >= 1
    printed = capsys.readouterr().out
    assert found["answer"] in printed and found["ranked"][0]["remedy"] in printed


def test_a_mistake_is_one_sentence(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([str(run), "--at", str(FRAMES)], [str(run), "--at", "-1"], [str(tmp_path / "none")]):
        assert main(["doctor", *words]) == 2
        assert capsys.readouterr().err.count("\n") == 1


@pytest.fixture
def interruptible() -> Iterator[None]:
    """A shell's background jobs, the tests among them, are started with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_it_between_two_pieces_of_its_work(
    run: Path, tmp_path: Path, interruptible: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reported = []

    def interrupted(sequence, stretch, seconds, report, origin):
        def again(progress):
            reported.append(progress)
            if len(reported) == 3:
                signal.raise_signal(signal.SIGINT)
            report(progress)

        return examine(sequence, stretch, seconds, again)

    monkeypatch.setattr(command, "examine", interrupted)
    out = tmp_path / "out"
    assert ended(["doctor", str(run), "--out", str(out)]) == 130
    printed = capsys.readouterr()
    assert len(reported) == 3 and not out.exists()
    assert not printed.out and "Traceback" not in printed.err


def ended(words: list[str]) -> int | str | None:
    """The exit code of a command."""
    try:
        return main(words)
    except SystemExit as end:
        return end.code
