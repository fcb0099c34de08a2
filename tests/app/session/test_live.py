"""A live camera in `ispom run`, `ispom sources` and the app: it ends when a person says so, and nothing is lost."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_folder import MARKER
from ispom_app.features.headless import play
from ispom_app.session import commands as do

from ispom.sequences import open_sequence
from ispom.sequences.formats import live
from tests import doubles
from tests.app.helpers import build, started, wait_for
from tests.sequences.folders import images
from tests.sequences.live_stream import streaming
from tests.sequences.own_folders import CAMERA

N = 12


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "SOURCE_TIMEOUT_S", 1.0)


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA)
    return path


def run(url: str, calibration: Path, out: Path, *options: str) -> int:
    return main(["run", url, "--camera", str(calibration), "--out", str(out), "--no-recording", *options], build)


def test_a_run_of_a_stream_that_ends_is_complete(calibration: Path, tmp_path: Path) -> None:
    with streaming(images(N, 0)) as stream:
        url = stream.url.replace("//", "//me:secret@")
        assert run(url, calibration, tmp_path / "out") == 0
    out = tmp_path / "out"
    run_file = yaml.safe_load((out / "run.yaml").read_text())
    assert run_file["exposures"] == {"video": N, "stereo": 0} and "ended by itself" in run_file["notes"][-1]
    assert run_file["source"] == stream.url and not any(b"secret" in p.read_bytes() for p in out.glob("*.[yjct]*"))
    assert len((out / "monocular.tum").read_text().splitlines()) == N and not (out / MARKER).exists()


def test_only_the_requested_images(calibration: Path, tmp_path: Path) -> None:
    with streaming(images(N, 0), holds=True) as stream:
        assert run(stream.url, calibration, tmp_path / "out", "--max-exposures", "5") == 0
    assert len((tmp_path / "out" / "monocular.tum").read_text().splitlines()) == 5


def test_an_interrupt_ends_the_recording_and_what_came_is_run(
    calibration: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted(play.StepLog):
        def add(self, event) -> None:
            super().add(event)
            if event.index == N - 1:
                signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(play, "StepLog", Interrupted)
    monkeypatch.setattr(live, "SOURCE_TIMEOUT_S", 600.0)  # what is compiled first may take minutes
    before = signal.getsignal(signal.SIGINT)
    with streaming(images(N, 0), holds=True) as stream:
        assert run(stream.url, calibration, tmp_path / "out") == 0
    assert len((tmp_path / "out" / "monocular.tum").read_text().splitlines()) == N
    assert not (tmp_path / "out" / MARKER).exists() and signal.getsignal(signal.SIGINT) is before


def test_a_stall_keeps_what_came_and_says_why(
    calibration: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with streaming(images(N, 0), holds=True) as stream:
        assert run(stream.url, calibration, tmp_path / "out") == 2
    assert "for 1 s after 12" in capsys.readouterr().err
    assert "12 of 12 frames: http" in (tmp_path / "out" / MARKER).read_text()
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["methods"]["monocular"]["poses"] == N


def test_what_is_seen_of_it_is_reported(calibration: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with streaming(images(N, 0), holds=True) as stream:
        assert main(["sources", stream.url, "--camera", str(calibration)]) == 0
    assert "video   96 x 64 px" in capsys.readouterr().out


def test_the_app_follows_it_and_another_source_ends_it(calibration: Path, tmp_path: Path) -> None:
    def opener(source: str):
        return doubles.sequence(20) if source.startswith("double") else open_sequence(source, camera=calibration)

    with streaming(images(N, 0), holds=True) as stream:
        session = started(tmp_path, stream.url, opener=opener)
        session.post(do.Speed(None))
        wait_for(lambda: session.state.computed == N and session.state.total == N, "all images")
        assert session.state.playing and not session.state.ended
        session.post(do.Seek(3))
        wait_for(lambda: session.state.index == 3 and not session.state.playing, "a look back")
        session.post(do.Open("double:20"))
        wait_for(lambda: session.state.question, "the question")  # nothing else keeps what the camera saw
        assert stream.url in session.state.question.text  # type: ignore[union-attr]
        session.post(do.Confirm(session.state.question.number, True))  # type: ignore[union-attr]
        wait_for(lambda: session.state.source == "double:20" and session.state.phase == "ready", "the other source")
        assert session.close(5.0)


def test_the_app_ends_with_the_stream(calibration: Path, tmp_path: Path) -> None:
    with streaming(images(N, 0)) as stream:
        session = started(tmp_path, stream.url, opener=lambda source: open_sequence(source, camera=calibration))
        session.post(do.Speed(None))
        wait_for(lambda: session.state.ended, "the end")
        assert session.state.computed == session.state.total == N and "ended by itself" in session.state.notes[-1]
        session.post(do.Restart(("monocular",), session.state.config))
        wait_for(lambda: session.state.run == 2 and session.state.ended, "the same again")
        assert session.state.computed == N and session.close(5.0)
