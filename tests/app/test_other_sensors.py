"""Measurements of other sensors among the frames: they are stepped on, counted and stored, but not drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ispom_app.engine.events import blank
from ispom_app.engine.history.encoding import decode, encode
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_folder.run_file import read_run_file, run_file
from ispom_app.engine.run_folder.thumbnail import thumbnail
from ispom_app.session import commands as do
from ispom_app.session import moves
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State
from ispom_app.views.rerun.file_recording import FileRecording
from ispom_app.views.rerun.parts import latest_of_each_camera
from ispom_app.views.viser import screen as screens
from ispom_app.views.viser.screen import Screen
from ispom_app.views.web.messages import message_of
from ispom_app.views.web.time_axis import AxisNews

from ispom import methods
from ispom.errors import InputError
from ispom.estimator import Method
from ispom.plausibility import Doubt
from ispom.types import Camera, Frame, GnssAntenna, GnssFix, Imu, ImuSamples, Measurement, Rig, Sequence, Status, Step
from tests import doubles
from tests.app.helpers import run_to_end, started, wait_for
from tests.app.rerun_log.test_recorder import read
from tests.app.viser_ui.conftest import server  # noqa: F401  (a fixture)
from tests.app.viser_ui.test_screen import FakeSession

FUSED = "fused_double"
RUN = ("monocular", "stereo", FUSED)


@dataclass(frozen=True)
class Config:
    def build(self, rig: Rig) -> Fused:
        return Fused(FUSED)


class Fused(doubles.FullEstimator):
    """Steps on video frames and fixes; of a fix it has a pose only."""

    def step(self, state: tuple[int, ...], exposure: Measurement, asked: object = None) -> tuple[tuple[int, ...], Step]:
        if isinstance(exposure, Frame):
            return super().step(state, exposure)
        pose = doubles.pose_at(exposure.time_ns)
        return (*state, exposure.time_ns), Step(exposure.time_ns, Status.TRACKING, "rig", pose, method=FUSED)


def sequence(frames: int = 20) -> Sequence:
    """The stand-in with fixes, IMU samples, and frames of a camera that the page does not know."""
    plain = doubles.sequence(frames)
    others: list[Measurement] = []
    for k, time_ns in enumerate(range(20_000_000, int(plain.times_ns[-1]), 100_000_000)):
        others.append(GnssFix(time_ns, np.array([1.0 * k, 0.0, 0.0]), np.eye(3)))
        others.append(ImuSamples(time_ns + 1, np.array([time_ns + 1]), np.zeros((1, 3)), np.zeros((1, 3))))
        others.append(Frame(time_ns + 2, {"back": np.zeros((48, 64), np.uint8)}))
    back = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)
    rig = plain.rig.changed(gnss=GnssAntenna(), imu=Imu(), back=back)
    changed = plain.with_measurements(others)
    return Sequence("with others", rig, changed.times_ns, changed.kinds, changed.load, plain.truth)


def build(config: methods.Config, wanted: tuple[str, ...], rig: Rig) -> Any:
    make = lambda name: Fused(name) if name == FUSED else doubles.FullEstimator(name)  # noqa: E731
    return doubles.ensemble(wanted, make)


@pytest.fixture(scope="module", autouse=True)
def fused() -> Iterator[Method]:
    """A method that uses fixes, in this process alone."""
    method = Method(FUSED, frozenset({"video", "gnss"}), Config, "metric", "a stand-in")
    methods.add(method)
    yield method
    methods.REGISTRY.remove(method)


@pytest.fixture(scope="module")
def run(fused: Method) -> CurrentRun:
    return run_to_end(Playback(sequence(), RUN, builder=build))


def of_kind(run: CurrentRun, kind: str) -> list[int]:
    return [i for i, each in enumerate(run.playback.sequence.kinds) if each == kind]


def test_each_method_steps_on_its_own_measurements_only(run: CurrentRun) -> None:
    for record in run.history:
        expected = {"video": {"monocular", FUSED}, "stereo": {"stereo"}, "gnss": {FUSED}}.get(record.kind, set())
        assert {step.method for step in record.steps} == expected
        assert record.kind == run.playback.sequence.kinds[record.index]
    assert len(run.finish().trajectories[FUSED]) == len(of_kind(run, "video")) + len(of_kind(run, "gnss"))


def test_records_of_them_are_kept_and_read_back(run: CurrentRun) -> None:
    for kind in ("gnss", "imu", "cameras"):
        record = run.history[of_kind(run, kind)[0]]
        again = decode(*encode(record))
        assert (again.kind, again.time_ns, len(again.steps)) == (kind, record.time_ns, len(record.steps))


def test_nothing_of_them_is_drawn(run: CurrentRun, tmp_path: Path) -> None:
    playback = Playback(sequence(), RUN, builder=build)
    with FileRecording(tmp_path / "run.rrd", playback.opened) as file:
        while not playback.done:
            file.write(playback.step())
        file.write(playback.finish())
    rows = read(tmp_path / "run.rrd")
    images = [row for row in rows["video/image"] if row.get("exposure") is not None]
    assert len(images) == len(of_kind(run, "video"))
    assert not any(name.startswith(("back", "gnss", "imu", "cameras")) for name in rows)
    assert f"world/{FUSED}/path/0" in rows


def test_the_page_shows_frames_and_counts_the_others(run: CurrentRun, server, tmp_path: Path, monkeypatch) -> None:  # noqa: F811
    session: Any = FakeSession(run, tmp_path)
    monkeypatch.setattr(screens, "PortlessViser", lambda label: SimpleNamespace(server=server))
    screen = Screen(session)
    screen.show_tabs(screen.tabs)
    for kind in ("gnss", "imu", "cameras", "video", "stereo"):
        session.seek(of_kind(run, kind)[1])
        screen.paint()
        assert message_of(session.state)["index"] == of_kind(run, kind)[1]
    news = AxisNews().since(session.state, run)
    kinds = run.playback.sequence.kinds
    letters = {"video": "v", "stereo": "s", "gnss": "g", "imu": "i", "cameras": "c"}
    assert news is not None and news["kinds"] == "".join(letters[kind] for kind in kinds)
    latest = latest_of_each_camera(kinds, of_kind(run, "gnss")[3])
    assert set(latest) == {"video", "left", "right", "camera"} and kinds[latest["left"]] == "stereo"


def test_files_of_a_run_count_them(run: CurrentRun) -> None:
    opened = run.playback.sequence
    found = run_file("double", opened, {}, {}).exposures
    assert found == {kind: opened.kinds.count(kind) for kind in set(opened.kinds)}
    for count in range(1, 8):
        assert (thumbnail(opened, count) is not None) == any(k in ("video", "stereo") for k in opened.kinds[:count])
    for i, kind in enumerate(opened.kinds):
        assert blank(opened, i).kind == kind


def test_a_doubt_is_a_note_in_the_files_of_a_run(tmp_path: Path) -> None:
    doubtful = sequence().with_notes([Doubt("imu_hole", "a hole")])
    (tmp_path / "run.yaml").write_text(run_file("double", doubtful, {}, {}).text)
    assert read_run_file(tmp_path).notes[-1] == "a hole"


def test_a_session_steps_over_them_and_keys_reach_stereo(tmp_path: Path) -> None:
    session = started(tmp_path, opener=lambda source, options=None: sequence(), builder=build, methods=RUN)
    try:
        session.post(do.Speed(None))
        session.post(do.Play(True))
        wait_for(lambda: session.state.ended, "the end")
        session.post(do.Seek(3))
        wait_for(lambda: session.state.index == 3, "frame 3")
        assert session.run is not None
        (event, *_) = moves.step_to(session.state, session.run, "stereo", forwards=True)
        assert session.run.playback.sequence.kinds[event.record.index] == "stereo"  # type: ignore[union-attr]
    finally:
        session.close(5.0)


def test_the_state_of_a_run_without_frames_is_one_that_can_be_shown() -> None:
    """As of a source that begins with other sensors."""
    fixes = [GnssFix(t, np.zeros(3), np.eye(3)) for t in (-30, -20, -10)]
    plain = doubles.sequence()
    early = plain.with_measurements(fixes)
    rig = plain.rig.changed(gnss=GnssAntenna())
    source = Sequence("begins with fixes", rig, early.times_ns, early.kinds, early.load)
    run = CurrentRun(Playback(source, RUN, builder=build), 10**8)
    run.step()
    assert AxisNews().since(State("double:20"), run) is not None


def test_a_run_leaves_out_what_lies_beside_and_none_of_its_methods_uses() -> None:
    plain = doubles.sequence()
    fixes = [GnssFix(int(t) + 1, np.zeros(3), np.eye(3)) for t in plain.times_ns[::3]]
    rig = plain.rig.changed(gnss=GnssAntenna())
    beside = replace(replace(plain, rig=rig).with_measurements(fixes), beside=frozenset({"gnss"}))
    run = Playback(beside, ("stereo",), builder=build)
    assert run.sequence.kinds == plain.kinds
    assert Playback(run.sequence, ("stereo", FUSED), builder=build).sequence is beside, (
        "begun again with another method"
    )
    fork = run.forked(3, ("monocular",), methods.Config())
    assert fork.sequence is run.sequence and len(fork.sequence) == len(plain), "a fork has the frames of its parent"
    with pytest.raises(InputError, match=FUSED):
        run.forked(3, ("stereo", FUSED), methods.Config())
