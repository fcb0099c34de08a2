"""Reading ahead changes when exposures are read, and nothing else."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

from ispom.errors import UnreadableImage
from ispom.sequences.prefetch import MAX_DECODED, prefetched
from ispom.types import Measurement, is_video
from tests import doubles

SEQUENCE = doubles.sequence(30)


class Source:
    """Tells who reads what; each read waits until it is allowed."""

    def __init__(self) -> None:
        self.reads: list[tuple[int, str]] = []
        self.read = threading.Semaphore(0)
        self.allowed = threading.Semaphore(0)

    def load(self, i: int) -> Measurement:
        self.reads.append((i, threading.current_thread().name.split("_")[0]))
        self.read.release()
        assert self.allowed.acquire(timeout=10)
        if i == 3:
            raise UnreadableImage("image 3 is damaged")
        return SEQUENCE.load(i)


def same(a: Measurement, b: Measurement) -> bool:
    name = "image" if is_video(a) else "right"
    return a.time_ns == b.time_ns and getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_the_same_exposures_in_any_order() -> None:
    ahead = prefetched(SEQUENCE)
    assert ahead.prepare is not None
    ahead.prepare(0)
    for i in [*range(10), 2, 20, 10, 11, 14, 13, *range(15, len(SEQUENCE))]:
        assert same(ahead[i], SEQUENCE[i])


def test_a_few_are_read_ahead_in_one_thread_and_no_more() -> None:
    source = Source()
    ahead = prefetched(replace(SEQUENCE, load=source.load))
    assert not source.reads and ahead.prepare is not None
    ahead.prepare(0)
    source.allowed.release(MAX_DECODED)
    for _ in range(MAX_DECODED):
        assert source.read.acquire(timeout=10)
    assert source.reads == [(i, "read-ahead") for i in range(MAX_DECODED)]
    ahead[0]
    assert source.read.acquire(timeout=10) and source.reads[MAX_DECODED:] == [(MAX_DECODED, "read-ahead")]
    source.allowed.release(MAX_DECODED)


def test_a_mistake_is_met_where_it_is() -> None:
    source = Source()
    source.allowed.release(100)
    ahead = prefetched(replace(SEQUENCE, load=source.load))
    assert ahead.prepare is not None
    ahead.prepare(0)
    for i in range(8):
        if i == 3:
            with pytest.raises(UnreadableImage, match="image 3"):
                ahead[i]
        else:
            assert same(ahead[i], SEQUENCE[i])


def test_starting_again_reads_from_there() -> None:
    source = Source()
    source.allowed.release(100)
    ahead = prefetched(replace(SEQUENCE, load=source.load))
    assert ahead.prepare is not None
    for start in (0, 20, 0):
        ahead.prepare(start)
        before = len(source.reads)
        assert same(ahead[start], SEQUENCE[start])
        assert "MainThread" not in [who for _, who in source.reads[before:]]


def test_what_prepares_by_itself_stays_as_it_is() -> None:
    own = replace(SEQUENCE, prepare=lambda _: None)
    assert prefetched(own) is own
