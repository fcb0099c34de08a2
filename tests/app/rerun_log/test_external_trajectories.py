"""Other programs' trajectories in a recording: frame-synchronised, and gone where they say nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from ispom_app.engine.playback import Playback, truth_from_start
from ispom_app.views.rerun.recorder import Recorder

from ispom.types import Trajectory
from tests import doubles
from tests.app import helpers
from tests.app.run.external_trajectories.made import elsewhere, external, written

SEQUENCE = doubles.sequence(60)
TRUTH = truth_from_start(SEQUENCE) or Trajectory.empty()


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory):
    """By entity: (frame, value) of what was logged."""
    rr.set_strict_mode(True)
    half = elsewhere(SEQUENCE).select(np.arange(40))
    path: Path = written(tmp_path_factory.mktemp("beside") / "a.tum", half)
    playback = Playback(SEQUENCE, ("stereo",), builder=helpers.build, external_trajectories=(external(SEQUENCE, path),))
    recorder = Recorder(playback.opened)
    found: dict[str, list[tuple[int, object]]] = {}
    batches = [recorder.opening()]
    while not playback.done:
        batches.append(recorder.batch(playback.step()))
    for batch in batches:
        for entry in batch.entries:
            found.setdefault(entry.path, []).append((batch.index, entry.value))
    return found


def test_its_pose_is_there_at_every_exposure_that_it_covers(logged) -> None:
    rig = logged["world/beside/orb/rig"]
    assert [i for i, value in rig if isinstance(value, rr.Transform3D)] == list(range(40))
    assert [i for i, value in rig if isinstance(value, rr.LineStrips3D)] == [0]
    assert [i for i, value in rig if isinstance(value, rr.Clear)] == [40]


def test_a_line_never_runs_ahead_of_the_exposure(logged) -> None:
    line = logged["world/beside/orb/path/0"]
    assert [i for i, _ in line] == list(range(40)), "again with each of its poses"
    last = line[20][1].strips.as_arrow_array().flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3)
    assert len(last) == 21
    assert np.allclose(last[-1], TRUTH.translations[20], atol=1e-5)


def test_its_error_curve_is_drawn_with_those_of_the_methods(logged) -> None:
    curve = logged["plots/error/beside/orb"]
    assert isinstance(curve[0][1], rr.SeriesLines) and [i for i, _ in curve[1:]] == list(range(40))
