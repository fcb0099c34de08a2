"""The diagnosis: a ranking of findings."""

from __future__ import annotations

from dataclasses import dataclass

from .finding import Ranked
from .reruns import Reruns


@dataclass(frozen=True)
class Diagnosis:
    """The answer, the strongest suspect first."""

    first: int
    last: int
    """Measurements of the sequence that were examined, both included."""
    ranked: tuple[Ranked, ...]
    silent: tuple[str, ...] = ()
    """Keys of suspects that the recording cannot test."""
    left: tuple[str, ...] = ()
    """Keys of suspects for which no time was left."""
    rivals: tuple[str, ...] = ()
    """Keys of causes that explain the stretch as well as the first one: the recording cannot tell which it is."""
    reruns: Reruns | None = None
    """Reruns of the run's own methods with other settings; None without a run, or if no rerun was requested."""
    set_back: Reruns | None = None
    """Reruns with one setting at a time set back to its default; None if no setting differs from its default."""

    @property
    def causes(self) -> tuple[Ranked, ...]:
        """Returns the suspects that were found to be causes, the strongest first."""
        return tuple(each for each in self.ranked if each.finding.found)

    @property
    def helped(self) -> Reruns | None:
        """The reruns with a setting that helped: those that set one back to its default first; None without one."""
        return next((r for r in (self.set_back, self.reruns) if r is not None and r.best is not None), None)

    @property
    def undecided(self) -> tuple[Ranked, ...]:
        """Returns the suspects whose evidence does not decide whether they are causes."""
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
