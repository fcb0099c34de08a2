"""Suspects of the doctor, and their findings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from .examination import Examination

How = Literal["setting", "images", "times", "tracks", "sensors", "counterfactual", "rerun"]
"""The source of the evidence. `counterfactual`: a changed calibration or clock, judged by held-out tracks; `sensors`:
other sensors, compared with the path of the images; `rerun`: the run's own method, forked before the stretch, with
another setting; `setting`: such a rerun with a setting set back to its default."""

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
    """If the recording cannot decide whether this is a cause: one sentence about what would decide it."""

    def __post_init__(self) -> None:
        """Rounds the figures to their significant digits. The same machine reproduces all digits; another one with
        another BLAS may not."""
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
    """One or two sentences about what to do."""
    examine: Callable[[Examination], Finding | None]
    """Examines a stretch. Returns None if the recording cannot test it, such as a clock with only one camera."""


@dataclass(frozen=True)
class Ranked:
    """A suspect with its finding."""

    suspect: Suspect
    finding: Finding
