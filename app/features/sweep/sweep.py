"""What is known of a sweep, as a value that grows by the messages of its process."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ...engine.options import SourceOptions
from ...session.state import FeatureState, State
from ..experiments.cluster import installed
from .values import Swept, Value, shown

SURE_S = 1.0
"""What is done after less says nothing of what is left."""


@dataclass(frozen=True)
class Outcome:
    """What came of one value."""

    value: Value
    folder: str
    """Of its run, below that of the sweep."""
    failure: str | None = None
    """One sentence; None where the run came to its end."""
    values: Mapping[str, float | None] | None = None
    """The numbers of the experiment's table."""
    ms: float | None = None
    """Median computing time of a frame."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep that was begun."""

    name: str
    """Of its folder, in the recordings folder."""
    swept: Swept
    source: str
    options: SourceOptions
    since_s: float
    """When it began (time.monotonic)."""
    outcomes: Mapping[int, Outcome]
    """Of the runs that are over, by the place of their value."""
    under_way: Mapping[int, float]
    """By the place of their value: the share of the frames that is computed."""
    left_s: float | None = None
    """The remaining time; None while it is not known."""
    ended: bool = False
    problem: str = ""
    """Why it ended early, in one sentence."""

    @staticmethod
    def begun(name: str, swept: Swept, source: str, options: SourceOptions, now_s: float) -> Sweep:
        return Sweep(name, swept, source, options, now_s, {}, {})

    @property
    def share(self) -> float:
        """Of all frames of all runs, 0..1."""
        return (len(self.outcomes) + sum(self.under_way.values())) / len(self.swept.values)

    def after(self, message: Mapping[str, Any], now_s: float) -> Sweep:
        """Returns the sweep after a message of its process."""
        match message:
            case {"at": [int(place), int(count), int(total)]}:
                found = replace(self, under_way={**self.under_way, place: count / max(total, 1)})
            case {"row": int(place), "folder": str(folder), "failure": failure, "values": values, "ms": ms}:
                outcome = Outcome(self.swept.values[place], folder, failure, values, ms)
                under_way = {at: share for at, share in self.under_way.items() if at != place}
                found = replace(self, outcomes={**self.outcomes, place: outcome}, under_way=under_way)
            case {"problem": str(problem)}:
                return replace(self, problem=problem)
            case _:
                return self
        spent_s, share = now_s - self.since_s, found.share
        return replace(found, left_s=spent_s * (1 - share) / share if spent_s > SURE_S and share else None)


def workers(values: int) -> int:
    """Runs at a time; 0: one after the other. A core is left to the page."""
    cores = (os.cpu_count() or 1) - 1
    return min(values, cores) if installed() and cores > 1 else 0


@dataclass(frozen=True)
class SweepState(FeatureState):
    sweep: Sweep | None = None

    def reduce(self, event: object) -> SweepState:
        return self  # also over another source

    def covered(self) -> SweepState:
        return SweepState()

    def page(self, state: State) -> dict[str, Any]:
        """Its folder, how far it is, and the errors of the runs that are over, by value."""
        sweep = self.sweep
        if sweep is None:
            return {"sweep": None}
        errors = {shown(o.value): (o.values or {}).get("ate_m") for o in sweep.outcomes.values()}
        found = {"name": sweep.name, "share": round(sweep.share, 3), "ended": sweep.ended, "ate_m": errors}
        return {"sweep": found}
