"""What the doctor looks for and what it says: a suspect, its finding, and the diagnosis, a ranking of findings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from .examination import Examination

if TYPE_CHECKING:
    from .reruns import Reruns

How = Literal["setting", "images", "times", "tracks", "counterfactual", "rerun"]
"""Where the evidence is from. `counterfactual`: a changed calibration or clock, and what held-out tracks say of it;
`rerun`: the run's own method, forked before the stretch, with another setting; `setting`: the same, with a setting that
differs from its default set back to it."""

DIGITS = 5
"""Significant digits of figures."""


@dataclass(frozen=True)
class Finding:
    """What the evidence says of one suspect."""

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


@dataclass(frozen=True)
class Diagnosis:
    """The answer, the strongest suspect first."""

    first: int
    last: int
    """Measurements of the sequence that were examined, both included."""
    ranked: tuple[Ranked, ...]
    silent: tuple[str, ...] = ()
    """Keys of suspects about which the recording says nothing."""
    left: tuple[str, ...] = ()
    """Keys of suspects for which no time was left."""
    rivals: tuple[str, ...] = ()
    """Keys of causes that explain the stretch as well as the first one: the recording cannot tell which it is."""
    reruns: Reruns | None = None
    """Of the run's own methods with other settings; None where there is no run, or nobody asked."""
    set_back: Reruns | None = None
    """With the settings that differ from their defaults set back to them, one at a time; None where none does."""

    @property
    def causes(self) -> tuple[Ranked, ...]:
        """Those that are there, the strongest first."""
        return tuple(each for each in self.ranked if each.finding.found)

    @property
    def helped(self) -> Reruns | None:
        """The reruns with a setting that helped: those that set one back to its default first; None without one."""
        return next((r for r in (self.set_back, self.reruns) if r is not None and r.best is not None), None)

    @property
    def undecided(self) -> tuple[Ranked, ...]:
        """Those of which the recording cannot tell whether they are there, though something speaks for them."""
        return tuple(each for each in self.ranked if each.finding.undecided)

    @property
    def answer(self) -> str:
        """One or two sentences."""
        if not self.causes:
            unknown = " The time was too short for all suspects." if self.left else ""
            tried = "".join(f" {each.answer}" for each in (self.set_back, self.reruns) if each is not None)
            if self.undecided:
                name, open_ = self.undecided[0].suspect.name, self.undecided[0].finding
                return f"Cannot tell whether {name}. {open_.evidence} {open_.undecided}{unknown}{tried}"
            return f"No single cause found: none of {len(self.ranked)} suspects explains this stretch.{unknown}{tried}"
        best = self.causes[0]
        others = [each.suspect.name for each in self.causes[1:] if each.suspect.key in self.rivals]
        if others and best.suspect.how == "counterfactual":
            which = f"{best.suspect.name}, or {', or '.join(others)}; the tracks cannot tell which"
            return f"The likely cause: {which}. {best.finding.evidence}"
        return f"The likely cause: {best.suspect.name}. {best.finding.evidence}"
