"""One frame of a run as it is stored: all results, without the images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ispom.geometry import Similarity
from ispom.types import Kind, Measurement, Status, Step

from ..events import Stepped
from ..verdict import Severity, verdict
from .quantities import Row, by_method, step_values


@dataclass(frozen=True)
class MethodStatus:
    """The status of a method at a frame: that of its latest step up to there."""

    status: Status
    error_m: float | None = None
    """Live error, as Stepped.errors_m; None where that is not known."""
    provisional: bool = False
    """Whether its pose is not metric yet."""
    word: str = ""
    """The headline of its verdict: "Tracking", "Provisional pose", "Scale unreliable"."""
    severity: Severity = Severity.OK

    @staticmethod
    def of(step: Step, error_m: float | None) -> MethodStatus:
        """Returns the status after a step. One function computes its word and that of the card."""
        found = verdict(step, 0, {})
        return MethodStatus(step.status, error_m, step.provisional, found.headline, found.severity)


@dataclass(frozen=True, eq=False)
class ExposureRecord:
    """One frame in the history: everything of Stepped except the images, which the sequence can give again."""

    index: int
    time_ns: int
    kind: Kind
    steps: tuple[Step, ...]
    placements: Mapping[str, Similarity]
    errors_m: Mapping[str, float]
    statuses: Mapping[str, MethodStatus]
    skipped: str = ""
    thinned: bool = False
    """Whether its tracks, landmarks and residuals were discarded to keep the history small; all else is there."""
    stored: Row | None = None
    """None if the frame was computed here. If it was read from a run's folder: all values of its row there, by method:
    quantities, checks, pose and digests. Its steps have no tracks, landmarks, residuals, covariances and revised poses
    then."""

    @staticmethod
    def of(event: Stepped, before: ExposureRecord | None) -> ExposureRecord:
        statuses = dict(before.statuses) if before else {}
        for step in event.steps:
            statuses[step.method] = MethodStatus.of(step, event.errors_m.get(step.method))
        return ExposureRecord(
            event.index,
            event.exposure.time_ns,
            event.exposure.kind,
            event.steps,
            event.placements,
            event.errors_m,
            statuses,
            event.skipped,
        )

    @property
    def values_by_method(self) -> Row:
        """Returns the values by key of each method that stepped on the frame."""
        if self.stored is not None:
            return self.stored
        return {m: step_values(step, self.errors_m.get(m)) for m, step in by_method(self.steps).items()}

    def stepped(self, exposure: Measurement) -> Stepped:
        """The event that this record came from, with its frame read again."""
        return Stepped(self.index, exposure, self.steps, self.placements, self.errors_m, self.skipped)


def with_parts(steps: tuple[Step, ...]) -> Iterator[Step]:
    """Yields the steps, and the steps of the estimators inside them; each object once."""
    seen: set[int] = set()
    waiting = list(reversed(steps))
    while waiting:
        step = waiting.pop()
        if id(step) not in seen:
            seen.add(id(step))
            yield step
            waiting += reversed(step.parts)


def size_bytes(record: ExposureRecord) -> int:
    """About what the record takes in memory."""
    total = 2000
    for step in with_parts(record.steps):
        points = [len(tracks) * 33 for tracks in (*step.tracks.values(), *step.other_motion.values())]
        total += sum(points) + 35 * len(step.landmarks) + 8 * len(step.residuals_px) + 104 * len(step.revised)
        total += sum(24 * len(lines) for lines in step.lines.values()) + 56 * len(step.world_lines)
        total += 3000 + 400 * len(step.decisions)
        total += sum(1000 + 104 * len(segment.video) for segment in step.segments)
        total += 1000 + 73 * len(step.spline.times_ns) + 56 * len(step.spline.knots_ns) if step.spline else 0
    return total
