"""Checks an estimate and its reference for all mistakes, one after the other, and measures how much each explains.

The best explanation is applied, and all tests are repeated, so that two mistakes in one file are both found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ispom.evaluation.audit.axes import axes
from ispom.evaluation.audit.clock import clock
from ispom.evaluation.audit.conventions import conventions
from ispom.evaluation.audit.correction import Correction, undone
from ispom.evaluation.audit.explanation import SAMPLES_NEEDED, Explanation, Scene
from ispom.evaluation.audit.finding import Finding, Measures
from ispom.evaluation.audit.jumps import Jump, jumps, parts
from ispom.evaluation.audit.lever_arm import lever_arm
from ispom.evaluation.audit.samples import Path
from ispom.evaluation.audit.stretches import copied, frozen
from ispom.evaluation.audit.unit import unit
from ispom.evaluation.comparison import AT_REST_M, Delta
from ispom.evaluation.relative_error import motion_errors
from ispom.evaluation.trajectory_error import MIN_POSES, Alignment, TrajectoryError, rms
from ispom.geometry import rotation_angle_rad
from ispom.types import Trajectory

MOST_FINDINGS = 4
"""Largest number of explanations that are applied one after the other."""
AS_GOOD = float(np.log(1.1))
"""Difference of the logarithms of errors below which two explanations are as good: 10 %."""
SAME_KEY = 0.5
"""Least gain, relative to the better one, with which either of both files may follow a convention."""
USUAL = (
    *("inverse", "w-first", "axes", "scale", "offset", "time_unit", "mirrored", "lever_arm"),
    *("w-last", "rotations-inverse", "drift"),
)
"""Mistakes by how often people report them, the most frequent first: the order of equally good explanations."""
NESTED = {("offset", "drift"), ("offset", "time_unit")}
"""Pairs of which the first one is a special case of the second: it is preferred where both are as good."""
MAX_ATE = 1.1
"""Largest ratio of the ATE with a correction to that without it: axes leave it unchanged, and where drift is most of
the error, a lever arm hardly reduces it."""
FEW = 0.5
"""Share of the poses of common times that must be associated, else the largest difference of times is widened."""
CLOCKS, BODIES = ("offset", "drift", "time_unit"), ("axes", "lever_arm")
"""Keys of explanations by clocks, and by another body."""
NOTHING = 0.5
"""Least error of aligned positions, relative to the extent of the reference, of two paths that have nothing in
common."""

Pairs = tuple[Trajectory, Trajectory]


@dataclass(frozen=True, eq=False)
class Question:
    """The requested comparison."""

    estimate: Trajectory
    reference: Trajectory
    associated: Callable[[Trajectory, Trajectory, float | None], Pairs]
    """Returns the associated poses of both, equally many, perhaps none. The last argument is the largest difference of
    times [s]; None: the requested one."""
    alignment: Alignment
    timed: bool = True
    paired: bool = False
    """Whether poses are paired by other means than times."""
    rotations: tuple[bool, bool] = (True, True)
    """Whether estimate and reference have rotations."""
    delta: Delta = Delta(1)
    align_first: int | None = None
    """Number of first poses that determine the alignment; None for all."""

    @property
    def with_scale(self) -> bool:
        return self.alignment in ("sim3", "scale")

    def pairs(self, correction: Correction) -> Pairs:
        estimate, reference = correction.of_estimate(self.estimate), correction.of_reference(self.reference)
        return self.associated(estimate, reference, correction.max_difference_s)

    def scene(self, correction: Correction) -> Scene:
        """Poses as corrected; stretches that are excluded are gaps of the reference."""
        estimate = correction.of_estimate(self.estimate)
        reference = undone(self.reference, correction.reference_conventions)
        if self.paired:
            estimate, reference = self.associated(estimate, reference, None)
        origin_ns = int(reference.times_ns[0])
        own, true = (Path.of(t, origin_ns, has) for t, has in zip((estimate, reference), self.rotations, strict=True))
        spans = [
            (first - origin_ns * 1e-9 - 1e-6, last - origin_ns * 1e-9 + 1e-6) for first, last in correction.excluded_s
        ]
        with_scale = self.with_scale or correction.with_scale
        return Scene(own.without(spans), true.without(spans), with_scale, self.timed, self.paired)

    def measures(self, correction: Correction) -> Measures:
        """Returns the errors of the corrected trajectories, as they are evaluated with the options for it."""
        own, true = self.pairs(correction)
        if len(own) < MIN_POSES:
            return {}
        kind = _scaled(self.alignment) if correction.with_scale else self.alignment
        error = TrajectoryError(own, true, kind, self.align_first)
        found: dict[str, float | None] = {
            "poses": len(own),
            "ate_m": error.ate_m,
            "ate_deg": None,
            "rpe_m": None,
            "rpe_deg": None,
        }
        if all(self.rotations):
            turns = np.swapaxes(true.rotations, 1, 2) @ error.aligned.rotations
            found["ate_deg"] = rms(np.degrees(rotation_angle_rad(turns)))
            first, last = self.delta.motions(true)
            if len(first):
                metres, radians = motion_errors(error.aligned, true, first, last)
                found["rpe_m"], found["rpe_deg"] = rms(metres), rms(np.degrees(radians))
        return found


def _scaled(alignment: Alignment) -> Alignment:
    return "scale" if alignment in ("none", "first") else "sim3"


def audit(question: Question) -> list[Finding]:
    """Returns the mistakes of the comparison, the most important first; empty without any."""
    if min(len(question.estimate), len(question.reference)) < MIN_POSES:
        return []
    rests = [float(np.ptp(t.translations, axis=0).max()) <= AT_REST_M for t in (question.estimate, question.reference)]
    if any(rests):
        # Nothing can be explained by a trajectory that rests. Where both rest, that is right.
        whose = "estimate" if rests[0] else "reference"
        return [] if all(rests) else [Finding("no_motion", whose, before=question.measures(Correction()))]
    faults = _faults(question, Correction())
    findings = _explained(question, _excluding(faults))
    clock_changed = any(f.key in CLOCKS for f in findings)
    if clock_changed:
        # Only now the poses of both are of the same moments.
        later = _faults(question, findings[-1].correction)
        if _excluding(later) != _excluding(faults):
            findings = _explained(question, _excluding(later))
        faults = later
    found = [*faults, *findings]
    return found or _nothing_in_common(question)


def _explained(question: Question, spans: tuple[tuple[float, float], ...]) -> list[Finding]:
    found = _greedy(question, spans)
    keys = [finding.key for finding in found]
    clocks = [key for key in CLOCKS if key in keys]
    if clocks and any(key in BODIES for key in keys[: keys.index(clocks[0])]):
        # A lever arm that was fitted to poses of different moments is not that of the body.
        found = _greedy(question, spans, first=clocks[0])
    return found


def _greedy(question: Question, spans: tuple[tuple[float, float], ...], first: str = "") -> list[Finding]:
    """Applies the best explanation, and tests again. `first` is the key of one that is applied before all others."""
    correction, found = Correction(excluded_s=spans), list[Finding]()
    before = question.measures(correction)
    for _ in range(MOST_FINDINGS):
        scene = question.scene(correction)
        known = {finding.key for finding in found}
        explanations = [e for e in _explanations(scene) if e.key not in known]
        leading = [e for e in explanations if e.key == first and e.named]
        step = _step(question, leading or explanations, correction, before)
        if step is None:
            break
        explanation, rivals, corrections, after = step
        found.append(_finding(scene, explanation, rivals, corrections, (before, after)))
        correction, before = corrections[1], after
        if rivals:
            break  # further results would depend on which of them is right
    return found


def _step(
    question: Question, explanations: list[Explanation], correction: Correction, before: Measures
) -> tuple[Explanation, list[Explanation], tuple[Correction, Correction], Measures] | None:
    """Returns the best explanation and its rivals, its correction and that with all before it, and the errors then;
    None where none is named. One that increases the ATE explains stretches only by making noise look small."""
    while (best := _best(explanations)) is not None:
        explanation, rivals = best
        whole = _associating(question, correction.then(explanation.correction))
        wider = whole.max_difference_s if whole.max_difference_s != correction.max_difference_s else None
        after = question.measures(whole)
        if not _worse(before, after):
            return explanation, rivals, (replace(explanation.correction, max_difference_s=wider), whole), after
        explanations = [e for e in explanations if e is not explanation]
    return None


def _worse(before: Measures, after: Measures) -> bool:
    a, b = before.get("ate_m"), after.get("ate_m")
    return a is not None and (b is None or b > MAX_ATE * a + 1e-9)


def _explanations(scene: Scene) -> Iterator[Explanation]:
    if len(scene.own) < 2 or len(scene.true) < 2:
        return
    yield from clock(scene)
    before = scene.samples()
    if len(before) < SAMPLES_NEEDED:
        return
    yield from conventions(scene, before)
    yield from axes(scene, before)
    yield from lever_arm(before)
    yield from unit(scene, before)


def _best(explanations: list[Explanation]) -> tuple[Explanation, list[Explanation]] | None:
    """Returns the best explanation, the most usual of equally good ones, and its rivals; None where none is named."""
    named = [e for e in explanations if e.named]
    if not named:
        return None
    best = max(named, key=lambda e: e.gain)
    equal = [e for e in named if e is best or _as_good(e, best)]
    equal.sort(key=lambda e: (_whose(e) == "reference", USUAL.index(e.key)))
    first = equal[0]
    return first, [e for e in equal[1:] if (first.key, e.key) not in NESTED]


def _as_good(other: Explanation, best: Explanation) -> bool:
    if other.key == best.key:
        # The same of the other file: its errors are of other poses, and only roughly comparable.
        return other.gain >= SAME_KEY * best.gain
    level = best.level
    return other.gain >= best.gain - 2 * AS_GOOD and _left(other, level) - _left(best, level) <= AS_GOOD


def _left(explanation: Explanation, level: int) -> float:
    """Returns the mean logarithm of the errors with an explanation."""
    after = explanation.after[min(level, len(explanation.after) - 1)]
    turns = 0.0 if after.rotation is None else np.log(after.rotation)
    return float((np.log(after.position) + turns).mean())


def _associating(question: Question, correction: Correction) -> Correction:
    """Widens the association, where a clock is corrected so that the times of hardly any poses are close."""
    own, true = correction.of_estimate(question.estimate), correction.of_reference(question.reference)
    if not question.timed or question.paired or min(len(own), len(true)) < MIN_POSES:
        return correction
    shorter, longer = sorted((own, true), key=len)
    common = (shorter.times_ns >= longer.times_ns[0]) & (shorter.times_ns <= longer.times_ns[-1])
    if len(question.pairs(correction)[0]) >= FEW * common.sum():
        return correction
    return replace(correction, max_difference_s=float(np.ceil(0.5e-6 * np.median(np.diff(longer.times_ns))) * 1e-3))


def _finding(
    scene: Scene,
    explanation: Explanation,
    rivals: list[Explanation],
    corrections: tuple[Correction, Correction],
    measured: tuple[Measures, Measures],
) -> Finding:
    blocks = len(explanation.gains[explanation.level])
    return Finding(
        explanation.key,
        _whose(explanation),
        explanation.values,
        explanation.sigmas,
        *measured,
        stretch_s=min(scene.own.span_s, scene.true.span_s) / blocks if scene.timed else None,
        fall=float(np.exp(-explanation.shown)),
        own=corrections[0],
        correction=corrections[1],
        rivals=tuple(_name(rival) for rival in rivals),
    )


def _whose(explanation: Explanation) -> str:
    return "reference" if explanation.correction.reference_conventions else "estimate"


def _name(explanation: Explanation) -> str:
    return f"{explanation.key} of the reference" if _whose(explanation) == "reference" else explanation.key


def _faults(question: Question, correction: Correction) -> list[Finding]:
    """Returns frozen and copied stretches, and jumps."""
    own, true = question.pairs(correction)
    if len(own) < MIN_POSES:
        return []
    before, found = question.measures(correction), list[Finding]()
    files = {"reference": (question.reference, true, own), "estimate": (question.estimate, own, true)}
    taken = list(correction.excluded_s)
    for whose, (whole, mine, other) in files.items():
        stretches = {"frozen": frozen(mine, other), "repeated": copied(mine)}
        spikes = [(j.first, j.last) for j in jumps(own, true) if j.whose == whose and j.last is not None]
        stretches["spikes"] = [(a, b) for a, b in spikes if not any(c <= a <= d + 1 for c, d in stretches["frozen"])]
        for key, ends in stretches.items():
            if not ends:
                continue
            spans = tuple((_s(true, a), _s(true, b)) for a, b in ends)
            taken += spans
            without = replace(correction, excluded_s=tuple(taken))
            after = question.measures(without)
            rows = tuple(
                _rows(whole, mine, a, b, question, correction if whose == "estimate" else None) for a, b in ends
            )
            found.append(
                Finding(
                    key,
                    whose,
                    before=before,
                    after=after,
                    own=Correction(excluded_s=spans),
                    correction=without,
                    spans_s=spans,
                    rows=rows,
                )
            )
            before = after
    return found + _steps(question, replace(correction, excluded_s=tuple(taken)), before)


def _steps(question: Question, correction: Correction, before: Measures) -> list[Finding]:
    """Returns jumps after which a path continues from another position."""
    own, true = question.pairs(correction)
    lasting = [j for j in jumps(own, true) if j.last is None]
    found = []
    for whose in ("reference", "estimate"):
        mine: list[Jump] = [j for j in lasting if j.whose == whose]
        if not mine:
            continue
        pieces = parts(len(own), [j.first for j in mine])
        errors = [
            TrajectoryError(own.select(p), true.select(p), question.alignment).ate_m if len(p) >= MIN_POSES else 0.0
            for p in pieces
        ]
        whole = float(np.sqrt(sum(e**2 * len(p) for e, p in zip(errors, pieces, strict=True)) / len(own)))
        if before.get("ate_m") is None or whole > NOTHING * (before["ate_m"] or 0.0):
            continue  # the parts fit no better than the whole: this is not the mistake
        spans = tuple((_s(true, j.first), _s(true, j.first)) for j in mine)
        found.append(
            Finding(
                "jumps",
                whose,
                before=before,
                after={"ate_m": whole},
                correction=correction,
                spans_s=spans,
                parts_m=tuple(errors),
            )
        )
    return found


def _s(trajectory: Trajectory, i: int) -> float:
    return float(np.longdouble(int(trajectory.times_ns[i])) / 10**9)


def _rows(
    whole: Trajectory, mine: Trajectory, first: int, last: int, question: Question, correction: Correction | None
) -> tuple[int, int]:
    """Returns the numbers of poses in the file, from 1, of associated poses."""
    times = whole.times_ns if correction is None else correction.of_estimate(question.estimate).times_ns
    if question.paired:
        return first + 1, last + 1
    a = int(np.searchsorted(times, mine.times_ns[first])) + 1
    b = int(np.searchsorted(times, mine.times_ns[last], side="right"))
    return a, b


def _excluding(faults: list[Finding]) -> tuple[tuple[float, float], ...]:
    return tuple(span for fault in faults if fault.key != "jumps" for span in fault.spans_s)


def _nothing_in_common(question: Question) -> list[Finding]:
    own, true = question.pairs(Correction())
    if len(own) < SAMPLES_NEEDED:
        return []
    ate_m = TrajectoryError(own, true, "sim3").ate_m
    extent = float(np.sqrt(((true.translations - true.translations.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if ate_m < NOTHING * extent or extent <= AT_REST_M:
        return []
    return [Finding("nothing_in_common", before=question.measures(Correction()), values={"extent_m": extent})]
