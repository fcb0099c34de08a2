"""Each run of the plan, before the change and after it, on the same images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError

from ..experiments.plan import Run
from ..experiments.row import Row, milliseconds
from ..experiments.statistics import value_of
from .change import FAILED

NOTHING = 1e-9
"""Added to both errors [their unit]: what is below a nanometre is rounding."""


@dataclass(frozen=True)
class Pair:
    """A run before and after."""

    before: Row
    after: Row
    folders: tuple[Path, Path] = (Path(), Path())

    @property
    def run(self) -> Run:
        return self.after.run

    def log_ratio(self, quantity: str) -> float | None:
        """The logarithm of after / before; None where one of them lacks the quantity."""
        before, after = value_of(self.before, quantity), value_of(self.after, quantity)
        if before is None or after is None:
            return None
        return math.log((after + NOTHING) / (before + NOTHING)) if after != before else 0.0

    def difference(self, quantity: str) -> float | None:
        """After - before; None where one of them lacks the quantity."""
        before, after = value_of(self.before, quantity), value_of(self.after, quantity)
        return None if before is None or after is None else after - before

    def score(self, quantity: str) -> float | None:
        """The same, with `FAILED` where only the run after lacks the quantity, and -`FAILED` where only that before."""
        had, has = self.gave(quantity)
        return self.log_ratio(quantity) if had == has else FAILED if had else -FAILED

    def gave(self, quantity: str) -> tuple[bool, bool]:
        """Whether the run has the quantity, before and after."""
        return value_of(self.before, quantity) is not None, value_of(self.after, quantity) is not None

    @property
    def log_time_ratio(self) -> float | None:
        """Of the median time per frame; None where it was not measured."""
        before, after = (milliseconds(self.run, folder)[0] for folder in self.folders)
        return math.log(after / before) if before and after else None


def paired(before: Sequence[Row], after: Sequence[Row], folders: tuple[Path, Path]) -> list[Pair]:
    """Returns the runs in pairs. Raises InputError where the two of a pair saw different images."""
    pairs = []
    for a, b in zip(before, after, strict=True):
        if a.images_sha256 and b.images_sha256 and a.images_sha256 != b.images_sha256:
            raise InputError(
                f"{a.run} saw other images in {folders[0]} than now: the recording or the simulation has changed, "
                "so run the baseline on these images"
            )
        pairs.append(Pair(a, b, (folders[0] / a.run.folder, folders[1] / b.run.folder)))
    return pairs
