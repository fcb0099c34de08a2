"""The history: bounded memory, nothing changed on its way to disk and back, and a stated rule for what goes first."""

from __future__ import annotations

import errno
import tempfile
from dataclasses import replace

import pytest
from ispom_app.engine.history import history as module
from ispom_app.engine.history.encoding import decode, encode
from ispom_app.engine.history.history import SEGMENTS, History, Past
from ispom_app.engine.history.record import ExposureRecord, size_bytes
from ispom_app.engine.playback import Playback

from ispom.solvers.trajectory.stages import stages
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.same import assert_same


def records(count: int) -> list[ExposureRecord]:
    run, found = Playback(doubles.sequence(count), METHODS, builder=helpers.build), list[ExposureRecord]()
    while len(found) < count:
        found.append(ExposureRecord.of(run.step(), found[-1] if found else None))
    return found


def test_a_record_reads_back_as_it_was() -> None:
    for record in records(12):
        assert_same(record, decode(*encode(record)))


def test_without_its_points_a_record_keeps_poses_statuses_and_decisions() -> None:
    record = next(r for r in records(12) if r.steps)
    thin = decode(encode(record)[0], None)
    step, whole = thin.steps[0], record.steps[0]
    assert thin.thinned and not any(map(len, step.tracks.values())) and not len(step.landmarks)
    assert_same([step.world_from_frame, step.revised, step.decisions], [
        whole.world_from_frame, whole.revised, whole.decisions
    ])  # fmt: skip


def test_how_an_integration_came_about_is_kept_and_given_up_with_the_points() -> None:
    run = Playback(doubles.sequence(30), ("integrated", "integrated.paper"), builder=helpers.build)
    event = next(event for event in iter(run.step, None) if any(step.segments for step in event.steps))
    record = ExposureRecord.of(event, None)
    spline, segments = record.steps
    assert spline.spline is not None and segments.segments
    assert_same(record, decode(*encode(record)))
    thin, thin_segments = decode(encode(record)[0], None).steps
    assert thin.spline is not None and not len(thin.spline.times_ns) and stages(thin_segments.segments[0]) == ()
    assert size_bytes(record) > size_bytes(replace(record, steps=(replace(spline, spline=None), segments))) + 1000


def test_memory_stays_within_the_budget_and_everything_is_still_there() -> None:
    wanted = records(60)
    budget = 5 * max(map(size_bytes, wanted))
    kept = History(memory_bytes=budget)
    for record in wanted:
        kept.append(record)
        assert kept.used_bytes <= budget
    assert len(kept) == 60 and kept.last is wanted[-1] and kept[-1] is wanted[-1]
    assert_same(wanted, list(kept))


@pytest.mark.parametrize("budget", [0, 200_000, 10**9])
def test_an_exposure_costs_the_same_work_whether_the_budget_is_full_or_not(
    monkeypatch: pytest.MonkeyPatch, budget: int
) -> None:
    encoded = list[int]()
    monkeypatch.setattr(module, "encode", lambda record: (encoded.append(record.index), encode(record))[1])
    kept = History(memory_bytes=budget)
    for record in records(40):
        kept.append(record)
        assert encoded == list(range(record.index + 1))


def test_beyond_the_budget_of_the_disk_the_oldest_lose_their_points_first() -> None:
    wanted = records(120)
    points = sum(len(encode(record)[1]) for record in wanted)
    kept = History(memory_bytes=0, disk_bytes=points // 2)
    for record in wanted:
        kept.append(record)
    thinned = [record.thinned for record in kept]
    first = kept.kept_points
    assert 0 < first < 120 and thinned == [True] * first + [False] * (120 - first)
    assert 0.5 - 2 / SEGMENTS < (120 - first) / 120 <= 0.55
    assert [r.steps[0].status for r in kept if r.steps] == [r.steps[0].status for r in wanted if r.steps]


def test_a_fork_has_the_points_of_its_past_as_far_as_those_are_kept() -> None:
    wanted = records(40)
    points = sum(len(encode(record)[1]) for record in wanted)
    for disk_bytes in (10**9, points // 2):
        parent = History(memory_bytes=0, disk_bytes=disk_bytes)
        for record in wanted[:30]:
            parent.append(record)
        fork = History(memory_bytes=0, past=Past(parent, 25, METHODS))
        for record in wanted[25:]:
            fork.append(record)
        assert fork.kept_points == parent.kept_points == sum(record.thinned for record in fork)


def test_a_full_disk_costs_tracks_and_no_exposure(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def seek(self, *_: object) -> None: ...
        def write(self, *_: object) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    wanted, kept = records(40), History(memory_bytes=0)
    for i, record in enumerate(wanted):
        if i == 20:
            monkeypatch.setattr(module, "TemporaryFile", lambda **_: Full())
            kept._facts._file = kept._points[-1]._file = Full()
        kept.append(record)
    assert kept[30].thinned and [s.method for s in kept[30].steps] == [s.method for s in wanted[30].steps]


def test_an_index_beyond_the_last_is_an_error() -> None:
    with pytest.raises(IndexError):
        History()[0]


def test_the_files_are_gone_with_the_history(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    kept = History(memory_bytes=0)
    for record in records(5):
        kept.append(record)
    assert len(kept) == 5 and not list(tmp_path.iterdir())
