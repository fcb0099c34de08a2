"""A fork runs with its own methods and settings from its frame on, and leaves the run that it came from alone.

That nothing differs where nothing was changed is in tests/app/test_forked.py."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from ispom_app.engine.events import Stepped
from ispom_app.engine.playback import Playback, Snapshot

from ispom.errors import InputError
from ispom.geometry import Similarity
from ispom.methods import Config
from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Frame, Measurement, Sequence, Step, TrackStatus, is_video
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.same import assert_same

DARK_NS = (800_000_000, 1_100_000_000)
"""Where there is no light: every method is lost there."""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """1.8 s of sim:tiny with a dark stretch; each frame made once."""
    bright = open_simulated("tiny", seed=0, cache_dir=tmp_path_factory.mktemp("rendered"), duration_s=1.8)

    def load(i: int) -> Measurement:
        found = bright[i]
        if not DARK_NS[0] <= found.time_ns < DARK_NS[1]:
            return found
        if is_video(found):
            return found.with_images(video=np.zeros_like(found.image))
        return Frame.stereo(found.time_ns, np.zeros_like(found.left), np.zeros_like(found.right))

    return replace(bright, load=cache(load))


class Said(NamedTuple):
    """What a frame's event says, but for wall times."""

    index: int
    steps: tuple[Step, ...]
    placements: dict[str, Similarity]
    errors_m: dict[str, float]


def timeless(step: Step) -> Step:
    """Without what the clock on the wall says."""
    return replace(step, seconds=dict.fromkeys(step.seconds, 0.0), parts=tuple(map(timeless, step.parts)))


def said(event: Stepped) -> Said:
    steps = tuple(timeless(step) for step in event.steps)
    return Said(event.index, steps, dict(event.placements), dict(event.errors_m))


def played(run: Playback) -> tuple[list[Said], list[Snapshot]]:
    """What is said of each frame, and the snapshot before it."""
    events, snapshots = [], []
    while run.more():
        snapshots.append(run.snapshot)
        events.append(said(run.step()))
    return events, snapshots


def test_a_run_forked_from_does_not_change(flight: Sequence) -> None:
    run = Playback(flight, METHODS)
    first = [run.step() for _ in range(20)][-1]
    snapshot, placements = run.snapshot, dict(first.placements)
    fork = run.forked(20, METHODS, Config(), snapshot)
    for _ in range(12):
        fork.step()
    again = Playback(flight, METHODS)
    assert_same([said(run.step()) for _ in range(20, 32)], [said(again.step()) for _ in range(32)][20:])
    assert_same(dict(first.placements), placements)


def changed_stereo(max_tracks: int) -> Config:
    settings = Config().of("stereo")
    return Config({"stereo": replace(settings, max_tracks=max_tracks)})


def tracked(events: list[Said]) -> list[int]:
    """Living tracks in the left image of each pair."""
    tracks = [steps[0].tracks["left"] for _, steps, *_ in events if steps]
    return [int(np.count_nonzero(t.status <= TrackStatus.NEW)) for t in tracks]


def test_other_settings_count_from_the_fork_on(flight: Sequence) -> None:
    run = Playback(flight, ("stereo",))
    events, snapshots = played(run)
    pairs = [i for i, steps, *_ in events if steps]
    at = pairs[2]
    config = changed_stereo(300)
    fork, _ = played(run.forked(at, ("stereo",), config))
    assert_same(fork[:at], events[:at])
    assert tracked(fork)[-1] <= 300 < tracked(events)[-1]
    assert_same(played(run.forked(at, ("stereo",), config, snapshots[at]))[0], fork[at:])


def test_a_fork_of_a_fork_keeps_what_ran_before(flight: Sequence) -> None:
    run = Playback(flight, ("stereo",))
    pairs = [i for i, kind in enumerate(flight.kinds) if kind == "stereo"]
    first = run.forked(pairs[2], ("stereo",), changed_stereo(150))
    second = first.forked(pairs[4], ("stereo",), Config())
    of_first, of_second = played(first)[0], played(second)[0]
    assert_same(of_second[: pairs[4]], of_first[: pairs[4]])
    assert [stage.until for stage in second.earlier] == [pairs[2], pairs[4]]
    before_it = first.forked(pairs[1], ("stereo",), Config())
    assert_same(played(before_it)[0], played(Playback(flight, ("stereo",)))[0])


def test_a_method_switched_on_starts_there_and_one_switched_off_ends_there() -> None:
    run = Playback(doubles.sequence(20), ("monocular", "stereo"), builder=helpers.build)
    fork = run.forked(10, ("stereo", "integrated"), Config())
    events = [fork.step() for _ in range(len(fork.sequence))]
    methods = [{step.method for step in event.steps} for event in events]
    assert set().union(*methods[:10]) == {"stereo"}
    assert set().union(*methods[10:]) == {"stereo", "integrated"}
    assert set(fork.finish().trajectories) == {"stereo", "integrated"}


def test_a_fork_that_ends_before_it_begins_has_its_methods_trajectories() -> None:
    fork = Playback(doubles.sequence(20), ("stereo",), builder=helpers.build).forked(10, METHODS, Config())
    fork.step()
    assert set(fork.finish().trajectories) == set(METHODS)


def test_a_mistake_in_the_settings_is_found_before_anything_runs(flight: Sequence) -> None:
    run = Playback(flight, ("stereo",))
    with pytest.raises(InputError, match=r"--stereo\.max-tracks is"):
        run.forked(10, ("stereo",), changed_stereo(-1))
