"""What is drawn over the frames: made again where what it is made of has changed, and gone with that."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from ispom_app.features.stage import painter as painters
from ispom_app.features.stage.painter import StagePainter
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce
from ispom_app.views.rerun.parts import SceneWriter
from ispom_app.views.rerun.tape import Tape

from tests.app.helpers import with_values


class Stage:
    """A session at one frame, and the tape of its run."""

    def __init__(self, run: CurrentRun, folder: Path) -> None:
        self.told = 0
        self.tape = Tape(folder, recording_id="double", kinds=lambda: run.opened.sequence.kinds)
        for frame in range(len(run.history)):
            self.tape.came(frame)
        self.session: Any = SimpleNamespace(
            state=with_values(reduce(State("double:40"), run.opened), displayed=run.history[30]),
            run=run,
            service=lambda kind: SimpleNamespace(run_of=lambda number: run),
            post=lambda command: None,
        )
        live: Any = SimpleNamespace(tape=self.tape, grown=SimpleNamespace(notify=self._notify))
        self.painter = StagePainter(self.session, live)

    def _notify(self) -> None:
        self.told += 1

    def becomes(self, **values: object) -> set[str]:
        """Paints the state, and returns what is over its frame."""
        self.session.state = with_values(self.session.state, **values)
        self.painter.paint()
        return {path for path, _ in self.tape.overlay.at(self.session.state.index)}


@pytest.fixture
def stage(run: CurrentRun, tmp_path: Path) -> Stage:
    return Stage(run, tmp_path)


def track(run: CurrentRun, index: int) -> str:
    """One that its frame sees, and that has a point."""
    steps = [step for step in run.history[index].steps if step.tracks]
    for step in steps:
        for tracks in step.tracks.values():
            both = set(tracks.ids.tolist()) & set(step.landmarks.ids.tolist())
            if both:
                return f"track:{step.method}:{min(both)}"
    raise AssertionError


def test_a_selected_track_is_marked_in_its_image_over_its_frame_alone(stage: Stage, run: CurrentRun):
    assert stage.becomes() == set()
    paths = stage.becomes(selected=track(run, 30))
    assert any(path.endswith("/selected") for path in paths) and stage.told == 1
    assert not any(path.endswith("/selected") for path, _ in stage.tape.overlay.at(29))
    stage.painter.paint()
    assert stage.told == 1, "nothing has changed"
    assert stage.becomes(selected="") == set() and stage.told == 2


def test_a_viewer_gets_what_is_drawn_and_loses_it_again(stage: Stage, run: CurrentRun):
    stage.becomes()
    writer = SceneWriter(stage.tape)
    writer.write(stage.tape.scene(30), 1)
    assert not writer.differs(stage.tape.scene(30))
    stage.becomes(selected=track(run, 30))
    assert writer.differs(stage.tape.scene(30))
    assert b"/selected" in writer.write(stage.tape.scene(30), 2)
    assert not writer.differs(stage.tape.scene(30))
    stage.becomes(selected="")
    assert b"/selected" in writer.write(stage.tape.scene(30), 3), "an empty value"
    writer.close()


def test_while_it_plays_what_takes_long_is_drawn_once_a_second(stage: Stage, run: CurrentRun, monkeypatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(painters, "time", SimpleNamespace(monotonic=lambda: clock.now))
    stage.becomes(look="geometry", playing=True)
    drawn = stage.painter._drawn["look"]
    stage.becomes(displayed=run.history[33])
    assert stage.painter._drawn["look"] == drawn
    clock.now += painters.PLAYING_S
    stage.becomes()
    assert stage.painter._drawn["look"] != drawn


def test_dense_depth_is_drawn_while_that_layer_is_chosen(stage: Stage, run: CurrentRun):
    assert stage.becomes() == set()
    assert stage.becomes(chosen=frozenset({"depth"})) == {"world/integrated/depth"}
    drawn = stage.painter._drawn["depth"]
    stage.becomes(displayed=run.history[29])
    assert stage.painter._drawn["depth"] == drawn, "of the same pair"
    stage.becomes(displayed=run.history[5])
    assert stage.painter._drawn["depth"] != drawn
    assert stage.becomes(hidden=frozenset({"integrated"})) == {"world/stereo/depth"}
    assert stage.becomes(chosen=frozenset()) == set()


def test_another_run_begins_with_nothing_drawn(stage: Stage, run: CurrentRun, tmp_path: Path):
    stage.becomes(selected=track(run, 30))
    stage.painter._live.tape = Tape(tmp_path, kinds=lambda: run.opened.sequence.kinds)  # type: ignore[misc]
    stage.painter.paint()
    assert stage.painter._live.tape.overlay.parts, "drawn there as well"
