"""What the doctor looks for and what it finds: a suspect, and its finding."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from .examination import Examination

How = Literal["setting", "images", "times", "tracks", "sensors", "counterfactual", "rerun"]
"""Where the evidence is from. `counterfactual`: a changed calibration or clock, and what held-out tracks say of it;
`sensors`: other sensors, against the path of the images; `rerun`: the run's own method, forked before the stretch, with
another setting; `setting`: the same, with a setting that differs from its default set back to it."""

DIGITS = 5
"""Significant digits of figures."""


@dataclass(frozen=True)
class Finding:
    """The evidence for one suspect."""

    strength: float
    """The evidence over its threshold: from 1 on the cause is there."""
    evidence: str
    """One sentence with its figures."""
    values: Mapping[str, float] = field(default_factory=dict)
    """The figures by name, with their unit in the name."""
    frames: tuple[int, ...] = ()
    """Measurements of the sequence that show it best, a few."""
    undecided: str = ""
    """What would decide it, one sentence, where the recording cannot tell whether the cause is there."""

    def __post_init__(self) -> None:
        """Rounds the figures to what they say. The same machine gives all digits again; another one with another BLAS
        may not."""
        object.__setattr__(self, "strength", _rounded(self.strength))
        object.__setattr__(self, "values", {name: _rounded(value) for name, value in self.values.items()})

    @property
    def found(self) -> bool:
        return self.strength >= 1 and not self.undecided

    @property
    def state(self) -> str:
        """One or two words: found, cannot tell, or not found."""
        return "found" if self.found else "cannot tell" if self.undecided else "not found"


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True)
class Suspect:
    """A possible cause: an entry of the table `SUSPECTS`."""

    key: str
    """Stable: in files and tests."""
    name: str
    """A few words, to be read after "The cause is:"."""
    how: How
    remedy: str
    """What to do, one or two sentences."""
    examine: Callable[[Examination], Finding | None]
    """None where the recording says nothing about it, such as of a clock where there is one camera."""


@dataclass(frozen=True)
class Ranked:
    """A suspect with its finding."""

    suspect: Suspect
    finding: Finding
