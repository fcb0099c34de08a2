"""A flight of three cameras kept as a user keeps one: a video file, two folders of images, and sequence.yaml."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.ensemble import build
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.types import Sequence, Trajectory
from tests.sequences.own_folders import write_sequence


def flown(sequence: Sequence) -> dict[str, Trajectory]:
    ensemble = build(Config(), ("monocular", "stereo", "integrated"), sequence.rig)
    state = ensemble.start()
    for i in range(len(sequence)):
        state, _ = ensemble.step(state, sequence[i])
    return ensemble.finish(state)


def test_the_simulation_through_files_gives_what_it_gives_itself(flight: Sequence, tmp_path: Path) -> None:
    source = flight.truncated(34)  # 1 s
    copy = open_sequence(str(write_sequence(tmp_path, source)))
    assert copy.kinds == source.kinds and copy.times_ns.tolist() == source.times_ns.tolist()
    assert copy.truth is not None and source.truth is not None and len(copy.truth) == len(copy)
    np.testing.assert_allclose(copy.truth.translations, source.truth.translations[: len(copy)], atol=1e-8)
    own, through = flown(source), flown(copy)
    np.testing.assert_array_equal(own["stereo"].translations, through["stereo"].translations)  # PNG loses nothing
    assert own["integrated"].times_ns.tolist() == through["integrated"].times_ns.tolist()
    apart_m = np.linalg.norm(own["integrated"].translations - through["integrated"].translations, axis=1)
    assert apart_m.max() < 0.01 * own["integrated"].length
