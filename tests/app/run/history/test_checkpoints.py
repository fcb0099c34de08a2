"""Checkpoints: evenly spread, within their budget, and what they share is counted once."""

from __future__ import annotations

import numpy as np
from ispom_app.engine.history.checkpoints import INTERVAL, Checkpoint, Checkpoints, size_bytes
from ispom_app.engine.model.run_model import RunModel, Tally
from ispom_app.engine.playback import Snapshot

EACH = 100_000


def checkpoint(position: int, *shared: np.ndarray) -> Checkpoint:
    states = {"stereo": (np.zeros(EACH // 8), *shared)}
    return Checkpoint(Snapshot(position, (), states, {}, {}), RunModel.start(()), Tally())


def filled(budget_bytes: int, exposures: int) -> Checkpoints:
    kept = Checkpoints(budget_bytes)
    for position in range(exposures):
        kept.offer(position, lambda position=position: checkpoint(position))
    return kept


def test_within_the_budget_there_is_one_at_every_interval() -> None:
    kept = filled(100 * EACH, 200)
    assert len(kept) == 200 // INTERVAL and kept.interval == INTERVAL
    nearest = kept.nearest(45)
    assert nearest is not None and nearest.snapshot.position == 40


def test_beyond_it_they_stay_evenly_spread_over_the_run() -> None:
    kept = filled(10 * EACH, 2000)
    assert kept.used_bytes <= 10 * EACH and kept.interval == 256
    assert [kept.nearest(p).snapshot.position for p in (255, 256, 1023, 1999)] == [0, 256, 768, 1792]  # type: ignore[union-attr]


def test_what_they_share_is_counted_once() -> None:
    large, seen = np.zeros(1_000_000), set[int]()
    assert size_bytes(checkpoint(0, large), seen) > 8_000_000
    assert size_bytes(checkpoint(1, large), seen) < 2 * EACH
    assert size_bytes(checkpoint(2, large[5:]), seen) < 2 * EACH, "a view of it, too"


def test_those_of_a_fork_end_where_it_begins() -> None:
    kept = filled(100 * EACH, 200)
    fork = kept.until(41)
    nearest = fork.nearest(100)
    assert nearest is not None and nearest.snapshot.position == 40 and len(kept) == 25


def test_with_a_smaller_budget_fewer_are_left() -> None:
    kept = filled(100 * EACH, 200)
    kept.limit(5 * EACH)
    assert 2 <= len(kept) <= 5 and kept.nearest(7) is not None


def test_none_before_the_first() -> None:
    assert Checkpoints(1).nearest(3) is None
