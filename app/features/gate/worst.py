"""The worst case, and where its two runs first differ, as `ispom diff` finds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ispom.errors import InputError
from ispom.io.files import exists

from ...engine.run_folder.run_folder import RUN
from ..diff.command import Compared, compared
from ..diff.text import lines, shown
from .judge import LOCATED, Judgement, Rules
from .pairs import Pair

FRAMES = 3
"""Frames that are shown: the first, and the next ones at which something else differs for the first time."""


@dataclass(frozen=True)
class Worst:
    """The pair that got worse most."""

    pair: Pair
    comparison: Compared | None
    """None where one of the runs left no folder."""

    @property
    def text(self) -> list[str]:
        """The settings that differ, and the first frames at which something does."""
        if self.comparison is None:
            return [f"no comparison: {self.pair.after.failure or self.pair.before.failure or 'a run is missing'}"]
        found = [f"setting {s.name}: {shown(s.a)} | {shown(s.b)}" for s in self.comparison.settings]
        found += [line for divergence in self.comparison.first for line in lines(divergence)]
        return [*found, f"the runs differ at {self.comparison.differing_frames} frames"]


def worst_first(pairs: Sequence[Pair], rules: Rules) -> list[Pair]:
    """Returns the pairs in order: newly failed ones, then by what was lost and by how much the first error grew."""

    def badness(pair: Pair) -> tuple[bool, float, float]:
        had, has = pair.gave(rules.quantities[0])
        fall = -(pair.difference(LOCATED) or 0.0)
        grown = max((log for q in rules.quantities if (log := pair.log_ratio(q)) is not None), default=0.0)
        return had and not has, fall if fall > rules.located else 0.0, grown

    return sorted(pairs, key=badness, reverse=True)


def worst_case(pairs: Sequence[Pair], judgements: Sequence[Judgement], rules: Rules) -> Worst | None:
    """Returns the worst pair, of lines that are worse where there are some; None where no pair got worse."""
    worse = {judgement.line for judgement in judgements if judgement.verdict == "worse"}
    own = [pair for pair in pairs if pair.run.line.name in worse] or pairs
    first = worst_first(own, rules)[0]
    had, has = first.gave(rules.quantities[0])
    grown = [log for q in rules.quantities if (log := first.log_ratio(q)) is not None]
    if max(grown, default=0.0) <= 0 and not (had and not has) and (first.difference(LOCATED) or 0.0) >= 0:
        return None
    if not all(exists(folder / RUN) for folder in first.folders):
        return Worst(first, None)
    try:
        return Worst(first, compared(*first.folders, count=FRAMES))
    except InputError:  # a run that failed may have stopped before anything was written
        return Worst(first, None)
