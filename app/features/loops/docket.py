"""The candidates of a run as they are decided: all on disk, some with their matches in memory."""

from __future__ import annotations

import heapq
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from itertools import count
from typing import Self

import msgspec

from ispom.estimators.modern.trials import Trial
from ispom.types import Sequence

from .candidate import Candidate, candidate_of, is_open

MOST_OPEN = 256
"""Candidates that wait for other images: more than a method keeps. The oldest are written then."""


class Docket(AbstractContextManager["Docket"]):
    """Takes trials frame by frame. Its memory is bounded by `most`, however long the run is."""

    def __init__(self, sequence: Sequence, most: int) -> None:
        self._sequence, self._most = sequence, most
        self._file = tempfile.TemporaryFile()  # noqa: SIM115, closed by __exit__
        self._open = dict[tuple[str, str, int, int], Trial]()
        self._shown: dict[bool, list[tuple[tuple[int, ...], int, Trial]]] = {True: [], False: []}
        """Of those that were accepted, and of others: the ones that came farthest."""
        self._serial = count()
        self.counts, self.decided_by = Counter[str](), Counter[str]()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, trials: Iterable[Trial]) -> None:
        """Adds what a frame found; writes what is decided."""
        for new in trials:
            one = self._open.pop(new.key, new)
            if one is not new:
                one.update(new)
            if is_open(one):
                self._open[one.key] = one
            else:
                self._write(one)
        while len(self._open) > MOST_OPEN:
            self._write(self._open.pop(next(iter(self._open))))

    def finish(self) -> None:
        """The run is over: what is open stays undecided."""
        for one in self._open.values():
            self._write(one)
        self._open.clear()

    def candidates(self) -> Iterator[Candidate]:
        """All that were written, in the order in which they were decided; one at a time is in memory."""
        self._file.seek(0)
        decoder = msgspec.json.Decoder(Candidate)
        for line in self._file:
            yield decoder.decode(line)

    def shown(self) -> list[Trial]:
        """Returns the trials with images, in order of time: half of them accepted, as far as there are enough of both
        kinds."""
        ranked = {accepted: [one for *_, one in sorted(some, reverse=True)] for accepted, some in self._shown.items()}
        fewest = self._most // 2
        others = min(len(ranked[False]), max(fewest, self._most - len(ranked[True])))
        chosen = [*ranked[True][: self._most - others], *ranked[False][:others]]
        return sorted(chosen, key=lambda one: (one.then_ns, one.first_ns))

    def _write(self, one: Trial) -> None:
        found = candidate_of(one, self._sequence)
        self.counts[f"{found.kind}.{found.verdict}"] += 1
        self.decided_by[found.decided_by or "undecided"] += 1
        self._file.write(msgspec.json.encode(found) + b"\n")
        rank = (one.pose is not None, sum(rule.passed for rule in one.rules.values()), found.inliers, found.matches)
        some = self._shown[found.verdict == "accepted"]
        heapq.heappush(some, (rank, next(self._serial), one))
        if len(some) > self._most:
            heapq.heappop(some)
