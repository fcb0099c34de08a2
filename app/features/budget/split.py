"""Removes one cause after another, and notes by how much the squared error falls."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from ispom.errors import InputError
from ispom.evaluation.budget.budget import (
    Budget,
    Cause,
    Share,
    common,
    fall_m2,
    mean_share,
    noise_share,
    share_of,
)
from ispom.evaluation.budget.known_poses import CLOCK, Calibrated, calibrated
from ispom.evaluation.budget.scale import scale_part_m2
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.hypothesis import Change
from ispom.evaluation.doctor.tracking import track
from ispom.methods import method as registered
from ispom.types import Sequence

from .bench import Bench, Errors, noise_of, noisier

LONGEST = 120
"""Frames of the main camera by which the calibration is estimated, in the middle of the run: more take memory, and say
little more."""
STARTS = 3
"""Later frames from which the run begins again."""
APART = 12
"""A run begins again after each such part of its frames: three starts are within the first quarter."""
RERUNS = 4
"""Number of reruns of each repetition: unchanged, with the calibration, with the clock, without contradicted tracks."""
FEW = "the rerun has too few poses at the frames of the run"


def frames_of(sequence: Sequence, repeats: int) -> int:
    """Returns how many frames are run in all, at most."""
    return len(sequence) * (RERUNS * (repeats + 1) + STARTS)


@dataclass(frozen=True, eq=False)
class Repeated:
    """A run, its repetitions with more noise, and the sequences of both."""

    sequences: tuple[Sequence, ...]
    errors: tuple[Errors, ...]
    first_pose: int
    """Frame at which all methods have one."""

    def again(self, rerun: Callable[[int, Sequence], Errors]) -> tuple[Errors, ...]:
        """Returns the errors of a rerun of each repetition, of which the number is given, too."""
        return tuple(rerun(k, sequence) for k, sequence in enumerate(self.sequences))

    def share(self, method: str, removed: tuple[Errors, ...]) -> Share | None:
        """Returns the share of what was removed, where each repetition was run again, or none was; None where that says
        too little."""
        falls = [
            fall_m2(before[method], after[method]) if method in before and method in after else None
            for before, after in zip(self.errors, removed, strict=False)
        ]
        known = [fall for fall in falls[1:] if fall is not None]
        return None if not falls or falls[0] is None else share_of(falls[0], known)


def budgets(bench: Bench, repeats: int, chosen: tuple[str, ...]) -> tuple[Budget, ...]:
    """Returns the budget of each chosen method. Raises InputError where none has an error."""
    unchanged, first_pose = bench.begun()
    names = [name for name in chosen if name in unchanged]
    if not names:
        raise InputError("no method has enough poses at times of the ground truth: there is no error to split")
    sigmas = noise_of(bench.sequence)
    sequences = (bench.sequence, *(noisier(bench.sequence, sigmas, k) for k in range(1, repeats + 1)))
    run = Repeated(sequences, (unchanged, *map(bench.errors, sequences[1:])), first_pose)
    found = _calibrated(bench.sequence)
    calibration, right = _calibration(bench, run, found, names)
    rows = [
        calibration,
        _clock(bench, run, found, names),
        {name: _noise(run, name, sigmas) for name in names},
        _outliers(bench, run, names),
        {name: _scale(name, right or run.errors, bool(right)) for name in names},
        _initial(bench, run, names),
    ]
    return tuple(
        Budget(
            name,
            unchanged[name].alignment,
            unchanged[name].ate_m,
            len(unchanged[name].estimate),
            tuple(row[name].told(unchanged[name].ate_m) for row in rows),
        )
        for name in names
    )


def _calibrated(sequence: Sequence) -> Calibrated | None:
    """Returns the calibration by the true poses, from a stretch in the middle."""
    kind = "video" if sequence.rig.video is not None else "stereo"
    main = [i for i, each in enumerate(sequence.kinds) if each == kind]
    if not main or sequence.truth is None:
        return None
    begin = max(0, (len(main) - LONGEST) // 2)
    seen = examination(sequence, main[begin], main[min(begin + LONGEST, len(main)) - 1])
    return calibrated(seen, track(seen), sequence.truth)


def _calibration(
    bench: Bench, run: Repeated, found: Calibrated | None, names: list[str]
) -> tuple[dict[str, Cause], tuple[Errors, ...]]:
    """Also returns the errors with the calibration."""
    label, removed = "calibration", "run again with the calibration set right"
    if found is None:
        return _none(label, removed, names, "too few tracks are seen from true poses"), ()
    numbers = tuple(name for name in found.names if name != CLOCK)
    if not numbers:
        return _none(label, removed, names, "the tracks show no error of the calibration"), ()
    removed = f"{removed}: {', '.join(_words(found, name) for name in numbers)}"
    right = run.again(lambda k, sequence: bench.corrected(_drawn(found, numbers, k), sequence))
    return {name: _row(label, removed, run.share(name, right)) for name in names}, right


def _words(found: Calibrated, name: str) -> str:
    at = found.names.index(name)
    return f"{name} {found.values[at]:+.2g}"


def _clock(bench: Bench, run: Repeated, found: Calibrated | None, names: list[str]) -> dict[str, Cause]:
    label, removed = "clock", "run again with corrected stamps of the video"
    rig = bench.sequence.rig
    if rig.video is None or not rig.has_stereo:
        return _none(label, removed, names, "the rig has one clock")
    if found is None or CLOCK not in found.names:
        why = "too few tracks are seen from true poses" if found is None else "the tracks show no error of the clock"
        return _none(label, removed, names, why)
    late_ms = found.change((CLOCK,)).perturbation.clock_ms
    removed = f"run again with the video's stamps {late_ms:+.2f} ms later"
    right = run.again(lambda k, sequence: bench.corrected(_drawn(found, (CLOCK,), k), sequence))
    return {name: _row(label, removed, run.share(name, right)) for name in names}


def _drawn(found: Calibrated, names: tuple[str, ...], repetition: int) -> Change:
    return found.drawn(names, repetition) if repetition else found.change(names)


def _noise(run: Repeated, method: str, sigmas: dict[str, float]) -> Cause:
    levels = ", ".join(f"{name} {sigma:.1f}" for name, sigma in sorted(sigmas.items()))
    noisy = [errors[method] for errors in run.errors[1:] if method in errors]
    removed = f"runs with as much noise again on the images ({levels} grey levels)"
    return _row("noise", removed, noise_share(run.errors[0][method], noisy))


def _outliers(bench: Bench, run: Repeated, names: list[str]) -> dict[str, Cause]:
    able = bench.leave_out()
    right = run.again(lambda k, sequence: bench.without_contradicted(sequence)) if able & set(names) else ()
    return {name: outlier_row(run.share(name, right), name in able) for name in names}


def outlier_row(share: Share | None, able: bool) -> Cause:
    """Returns the row of the outliers. Where not even the last digit changes, no track was left out: what the method
    itself rejected does not show."""
    label, removed = "outliers", "run again without the tracks that contradict the true poses"
    if not able:
        return Cause(label, removed, unknown="the method cannot leave out tracks")
    if share is not None and share.value_m2 == share.half_m2 == 0:
        return Cause(label, removed, unknown="no track of the method contradicts the true poses")
    return _row(label, removed, share)


def _scale(method: str, errors: Iterable[Errors], calibrated: bool) -> Cause:
    metric = registered(method).unit == "metric"
    removed = "the scale of the whole path set right" if metric else "the scale along the path set right"
    removed += ", after the calibration" if calibrated else ""
    parts = [scale_part_m2(each[method]) if method in each else None for each in errors]
    known = [part for part in parts[1:] if part is not None]
    share = None if not parts or parts[0] is None else share_of(parts[0], known)
    return _row("scale", removed, share, "the path is too short")


def _initial(bench: Bench, run: Repeated, names: list[str]) -> dict[str, Cause]:
    sequence = bench.sequence
    starts = later_starts(sequence, run.first_pose)
    label, removed = "initial map", f"run again from the frames {', '.join(map(str, starts)) or '-'}"
    begun = [bench.errors(sequence.part(start, len(sequence) - 1)) for start in starts]
    found = dict[str, Cause]()
    for name in names:
        before, falls = run.errors[0][name], list[float]()
        for errors in begun:
            both = common(before, errors[name]) if name in errors else None
            if both is not None and both[0].ate_m > 0:
                falls.append(before.ate_m**2 * (1 - (both[1].ate_m / both[0].ate_m) ** 2))
        found[name] = _row(label, removed, mean_share(falls))
    return found


def later_starts(sequence: Sequence, first_pose: int) -> list[int]:
    """Returns frames after the first pose from which the run may begin again, of the kind that is seen least often: no
    two begin with the same frame of a method."""
    kinds = [kind for kind in sequence.kinds if kind in ("video", "stereo")]
    if not kinds:
        return []
    rare = min(sorted(set(kinds)), key=kinds.count)
    after = [i for i, kind in enumerate(sequence.kinds) if kind == rare and i > first_pose]
    every = max(1, len(after) // APART)
    return after[every - 1 : STARTS * every : every]


def _row(label: str, removed: str, share: Share | None, unknown: str = FEW) -> Cause:
    return Cause(label, removed, share, "" if share is not None else unknown)


def _none(label: str, removed: str, names: list[str], why: str) -> dict[str, Cause]:
    return {name: Cause(label, removed, unknown=why) for name in names}
