"""The engine that experiments, gates, sweeps and triages share."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import pytest
from ispom_app.features.experiments.jobs import Jobs, part, take_all, whole
from ispom_app.features.experiments.options import Parallel
from ispom_app.features.experiments.shards import Shard

from ispom.errors import InputError


@dataclass(frozen=True)
class Job:
    source: str
    seed: int = 0


class Stopping:
    """Signals that stop the work after `after` jobs."""

    def __init__(self, after: int) -> None:
        self.left = after

    def check(self) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


def never(*_: object) -> str:
    raise AssertionError("sent to a worker")


def jobs(out: Path, *names: str) -> Jobs[str, Job, str]:
    return Jobs("order", [Job(name) for name in names], out, never, never)


def test_without_workers_jobs_are_computed_in_order_and_only_when_they_are_asked_for(tmp_path: Path) -> None:
    begun = list[str]()

    def here(job: Job) -> str:
        begun.append(job.source)
        return job.source.upper()

    done = jobs(tmp_path, "b", "a", "c").computed(Parallel(), 0, here)
    assert next(done) == "B" and begun == ["b"]
    assert list(done) == ["A", "C"]


def test_nothing_is_left_and_no_cluster_is_asked(tmp_path: Path) -> None:
    assert list(jobs(tmp_path).computed(Parallel(scheduler="tcp://127.0.0.1:9"), 4, never)) == []


@pytest.mark.parametrize("after", [1, 2])
def test_a_signal_ends_it_with_what_was_taken_and_closes_what_computes(after: int) -> None:
    closed, taken = list[bool](), list[int]()

    def computing() -> Generator[int, None, None]:
        try:
            yield from range(5)
        finally:
            closed.append(True)

    with pytest.raises(KeyboardInterrupt):
        take_all(computing(), iter, taken.append, Stopping(after))  # type: ignore[arg-type]
    assert taken == list(range(after)) and closed == [True]


def test_a_part_keeps_others_from_itself_and_from_the_whole(tmp_path: Path) -> None:
    with part(tmp_path, Shard(1, 2)) as report:
        assert report.parent.is_dir()
        with part(tmp_path, Shard(2, 2)):
            pass
        with pytest.raises(InputError, match="another run"), part(tmp_path, Shard(1, 2)):
            pass
        with pytest.raises(InputError, match=r"1-of-2.*or else"), whole(tmp_path, ", or else"):
            pass
    with whole(tmp_path), pytest.raises(InputError), whole(tmp_path):
        pass
