"""Without ground truth other programs' trajectories are drawn among the poses of a method, again as those grow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from ispom_app.engine.external_trajectories.placed import Placed
from ispom_app.engine.external_trajectories.places import Places
from ispom_app.engine.model.run_model import RunModel
from ispom_app.engine.playback import Playback
from numpy.testing import assert_allclose

from tests import doubles
from tests.app import helpers
from tests.app.run.external_trajectories.made import elsewhere, external, written

SEQUENCE = replace(doubles.sequence(60), truth=None)


def followed(path: Path, methods: tuple[str, ...], *alignments: str) -> list[Placed | None]:
    """Where it is after each frame."""
    found = (external(SEQUENCE, path, "orb", *alignments),)
    playback = Playback(SEQUENCE, methods, builder=helpers.build, external_trajectories=found)
    places, model, seen = Places(playback.opened), RunModel.start(methods), list[Placed | None]()
    while not playback.done:
        event = playback.step()
        model = model.after(event.index, event.exposure.time_ns, event.steps)
        seen.append(places.at(model, event.placements).get("orb"))
    return seen


def test_it_is_aligned_to_the_first_metric_method(tmp_path: Path) -> None:
    seen = followed(written(tmp_path / "a.tum", elsewhere(doubles.sequence(60))), ("monocular", "stereo", "integrated"))
    last = seen[-1]
    assert seen[0] is None and last is not None
    assert "stereo by se3" in last.alignment
    true = np.stack([doubles.pose_at(int(t)).translation for t in SEQUENCE.times_ns])
    assert_allclose(last.positions, true, atol=1e-4)


def test_it_moves_only_when_there_are_twice_as_many_poses(tmp_path: Path) -> None:
    seen = followed(written(tmp_path / "a.tum", elsewhere(doubles.sequence(60))), ("integrated",))
    assert len({id(placed) for placed in seen if placed is not None}) == 5, "of 4, 8, 16, 32 and 64 poses"


def test_a_method_without_metric_unit_gives_its_unit(tmp_path: Path) -> None:
    path = written(tmp_path / "a.tum", elsewhere(doubles.sequence(60), unit_m=0.2))
    last = followed(path, ("monocular",))[-1]
    assert last is not None and "by sim3" in last.alignment and "scale 0.2" in last.alignment
