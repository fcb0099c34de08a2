"""What doctor.json holds."""

from __future__ import annotations

import msgspec

from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Ranked
from ispom.evaluation.doctor.reruns import Outcome, Reruns

from ...engine.run_events.stretch import Stretch


class SuspectRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A suspect with its evidence."""

    key: str
    cause: str
    how: str
    """Where the evidence is from."""
    found: bool
    undecided: str
    """What would decide it, where the recording cannot tell."""
    strength: float | None
    """The evidence over its threshold."""
    evidence: str
    values: dict[str, float | None]
    """The figures by name, with their unit in the name."""
    frames: list[int]
    remedy: str


class UnchangedRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a method did over the stretch with its own settings."""

    method: str
    frames: int
    located: int
    segments: int
    failed: dict[str, int]
    """By key of a check: in how many frames it failed."""
    error_m: float | None


class TriedRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How it did with another setting."""

    option: str
    helps: bool
    reruns: int
    frames: int
    located: int
    segments: int
    failed: dict[str, int]
    error_m: float | None


class RerunsRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Reruns of the stretch, one setting changed at a time."""

    first: int
    last: int
    answer: str
    unchanged: list[UnchangedRow]
    tried: list[TriedRow]
    left: list[str]
    """Settings for which no time was left."""


class DoctorFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What doctor.json holds."""

    first: int
    last: int
    """Frames that were examined, both included."""
    at: int
    event: str | None
    answer: str
    causes: list[str]
    """Keys of what was found, the strongest first."""
    ranked: list[SuspectRow]
    rivals: list[str]
    """Keys of causes that explain as much: the recording cannot tell."""
    silent: list[str]
    """Keys of suspects about which the recording says nothing."""
    left: list[str]
    """Keys of suspects for which no time was left."""
    set_back: RerunsRow | None
    """With the settings that differ from their defaults set back, one at a time."""
    reruns: RerunsRow | None


def written(found: Diagnosis, stretch: Stretch) -> DoctorFile:
    """Returns what doctor.json holds."""
    return DoctorFile(
        stretch.first,
        stretch.last,
        stretch.at,
        None if stretch.event is None else stretch.event.sentence,
        found.answer,
        [each.suspect.key for each in found.causes],
        [_suspect(each) for each in found.ranked],
        list(found.rivals),
        list(found.silent),
        list(found.left),
        None if found.set_back is None else _reruns(found.set_back),
        None if found.reruns is None else _reruns(found.reruns),
    )


def _suspect(each: Ranked) -> SuspectRow:
    suspect, finding = each.suspect, each.finding
    return SuspectRow(
        suspect.key, suspect.name, suspect.how, finding.found, finding.undecided, finding.strength, finding.evidence,
        dict(finding.values), list(finding.frames), suspect.remedy,
    )  # fmt: skip


def _reruns(reruns: Reruns) -> RerunsRow:
    unchanged = {t.trial.method: t.unchanged[0] for t in reruns.tried}
    return RerunsRow(
        reruns.first,
        reruns.last,
        reruns.answer,
        [UnchangedRow(method, *_outcome(outcome)) for method, outcome in unchanged.items()],
        [TriedRow(t.trial.option, t.helps, len(t.outcomes), *_outcome(t.outcomes[0])) for t in reruns.tried],
        list(reruns.left),
    )


def _outcome(outcome: Outcome) -> tuple[int, int, int, dict[str, int], float | None]:
    return outcome.frames, len(outcome.located), outcome.segments, dict(outcome.failed), outcome.error_m
