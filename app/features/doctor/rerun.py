"""Reruns a run, or forks it before its bad stretch: unchanged first, then with one setting changed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ispom.errors import InputError
from ispom.evaluation.doctor.reruns import Outcome, Reruns, Trial, Tried
from ispom.evaluation.trajectory_error import alignment_of, error_against_truth
from ispom.methods import Config
from ispom.methods import method as registered
from ispom.settings import alternatives, not_default
from ispom.types import Frame, Image, Measurement, Sequence, Step

from ...engine.differences.compare import FOLLOWED, MethodRow, divergences, step_row
from ...engine.playback import Playback, Snapshot
from ...engine.run_events.stretch import Stretch
from ...engine.run_events.table import EventRecorder
from .origin import Origin, without_points

SEEDS = (None, 1, 2)
"""Seeds of the repetitions of a rerun: None has the images unchanged, the others add noise to them."""
NOISE = 1
"""Largest noise of a repetition [grey levels]: less than that of any camera, and enough for other tracks."""
WHOLE = 400
"""Most measurements of a run that is rerun from start to end where a setting is set back; of a longer run only the
stretch is rerun."""
NOT_SET_BACK = "Not all settings were set back to their defaults: no time was left."
NOT_TRIED = "Settings not tried: no time was left."
REPAIRED = "Nothing is left to improve then, so no other setting of {} was tried."
KNOWN = "Other settings were not tried: one that was set back to its default explains it."
TOO_LITTLE = "The run lost too little there for a setting to help, so none was tried."
Advance = Callable[[str], bool]
"""Called before each frame with what is done; False where no time is left. It may raise to end the work."""
Known = Callable[[Reruns], None]
"""Called with what reruns have shown so far, each time that one of a setting has ended."""
Steps = Mapping[str, list[tuple[int, Step]]]
"""By method: its steps by the index of their frame."""


class _Late(Exception):
    """No time is left."""


def set_back(origin: Origin, stretch: Stretch, advance: Advance, known: Known = lambda reruns: None) -> Reruns | None:
    """Returns what happens where a setting that differs from its default is set back to it, one at a time; None where
    all are as by default. The same run gives the same answer, but for what `advance` left out.

    A short run is rerun as a whole, for a setting acts from the start. Ground truth, where there is one, judges the
    outcomes and nothing else. `known` is called with what was seen so far.
    """
    try:
        playback = origin.afresh()
    except InputError as fault:
        return Reruns(stretch.first, stretch.last, note=f"The run cannot be rerun: {fault}.", set_back=True)
    about = stretch.event.method if stretch.event is not None else ""
    trials = [
        Trial(m, name, getattr(playback.config.of(m), name), value)
        for m in sorted(playback.methods, key=lambda m: m != about)
        for name, value in not_default(playback.config.of(m))
    ]
    if not trials:
        return None
    own = max((stage.until for stage in playback.earlier), default=0)
    end = len(playback.sequence) - 1
    first, last = (own, end) if end - own < WHOLE else (max(own, stretch.first), stretch.last)
    tried, left, note = list[Tried](), [trial.option for trial in trials], ""
    try:
        for _ in _played(playback, first - 1, "reaching the stretch", advance):
            pass
        kind = stretch.event.kind if stretch.event is not None else ""
        bench = _Bench(playback, playback.snapshot, first, last, advance, kind=kind, judged=True)
        for trial in trials:
            tried.append(bench.tried(trial, lambda now: known(Reruns(first, last, (*tried, now), set_back=True))))
            left.remove(trial.option)
    except _Late:
        note = NOT_SET_BACK
    except InputError as fault:
        note = f"The run cannot be rerun: {fault}."
    return Reruns(first, last, tuple(tried), tuple(left), note, set_back=True)


def rerun(
    origin: Origin,
    stretch: Stretch,
    advance: Advance,
    before: Reruns | None = None,
    known: Known = lambda reruns: None,
) -> Reruns:
    """Returns what other settings do to the stretch. The same run gives the same answer, but for what `advance` left
    out. `known` is called with what was seen so far.

    A setting is tried for each method that lost frames or failed checks there, that of the event first, until one
    leaves nothing to improve. Not tried are the methods of which `before`, the settings that were set back, has the
    cause, and what it tried.
    """
    first, last = stretch.first, stretch.last
    try:
        playback = origin.begin()
        first = max(first, *(stage.until for stage in playback.earlier), 0)
        rows = [row for row in origin.rows(first, last) if row.method in playback.methods]
        if not rows:
            return Reruns(first, last, note="The run did not compute this stretch itself, so no setting was tried.")
        last = rows[-1].exposure
        for _ in _played(playback, first - 1, "reaching the stretch", advance):
            pass
        bench = _Bench(playback, playback.snapshot, first, last, advance)
        unchanged = bench.unchanged()
    except _Late:
        return Reruns(first, last, note=NOT_TRIED)
    except InputError as fault:
        return Reruns(first, last, note=f"The stretch cannot be rerun: {fault}.")
    note = _difference(rows, bench.rows)
    known_before = () if before is None else before.tried
    explained = {each.trial.method for each in known_before if each.helps}
    about = stretch.event.method if stretch.event is not None else ""
    order = sorted(unchanged, key=lambda m: m != about)
    bad = [m for m in order if m not in explained and Outcome.of(unchanged[m]).improvable]
    trials = [
        Trial(m, name, getattr(playback.config.of(m), name), value)
        for m in bad
        for name, value in alternatives(playback.config.of(m))
    ]
    trials = [trial for trial in trials if trial not in [each.trial for each in known_before]]
    if not trials:
        note = f"{note} {KNOWN if explained else TOO_LITTLE}".lstrip()
    tried, left, repaired = list[Tried](), list[str](), set[str]()
    for trial in trials:
        if trial.method in repaired:
            continue
        try:
            tried.append(bench.tried(trial, lambda now: known(Reruns(first, last, (*tried, now)))))
        except _Late:
            left.append(trial.option)
        except InputError as refused:
            left.append(f"{trial.option} ({refused})")
        else:
            if tried[-1].helps and not any(outcome.improvable for outcome in tried[-1].outcomes):
                repaired.add(trial.method)
                note = f"{REPAIRED.format(trial.method)} {note}".rstrip()
    return Reruns(first, last, tuple(tried), tuple(left), note)


@dataclass
class _Bench:
    """Runs forks of one state over the stretch."""

    playback: Playback
    """Which is forked, and not stepped."""
    snapshot: Snapshot
    first: int
    last: int
    advance: Advance
    rows: list[MethodRow] = field(default_factory=list)
    """Of the unchanged rerun."""
    known: dict[str, list[Outcome]] = field(default_factory=dict)
    """By method: of the unchanged repetitions so far."""
    known_later: dict[str, Outcome] = field(default_factory=dict)
    """By method: of the unchanged settings in the frames after the stretch."""
    kind: str = ""
    """Of the event that is to be explained."""
    judged: bool = False
    """Whether outcomes have an error against the ground truth, and their events."""

    def unchanged(self) -> Steps:
        """All methods with their own settings: the steps, which must be those of the run."""
        found = defaultdict[str, list[tuple[int, Step]]](list)
        fork = self.playback.forked(self.first, self.playback.methods, self.playback.config, self.snapshot)
        for event in _played(fork, self.last, "rerunning the stretch unchanged", self.advance):
            for step in event.steps:
                found[step.method].append((event.index, step))
                self.rows.append(step_row(event.index, step, event.errors_m.get(step.method)))
        self.known = {method: [Outcome.of(steps)] for method, steps in found.items()}
        return found

    def tried(self, trial: Trial, seen: Callable[[Tried], None]) -> Tried:
        """A trial; where it helps, with its repetitions, and those of the unchanged settings. `seen` is called with it
        after each of these. Raises _Late."""
        known = self.known.setdefault(trial.method, [])
        if not known:
            known.append(self._outcome(replace(trial, value=trial.before), None))
        found = Tried(trial, (self._outcome(trial, None),), tuple(known), event=self.kind)
        seen(found)
        for seed in SEEDS[len(known) :] if found.helps else ():
            known.append(self._outcome(replace(trial, value=trial.before), seed))
        found = replace(found, unchanged=tuple(known))
        for seed in SEEDS[1:]:
            if found.helps:
                found = replace(found, outcomes=(*found.outcomes, self._outcome(trial, seed)))
                seen(found)
        if found.helps and self.last < len(self.playback.sequence) - 1:
            found = replace(found, later=self._later(trial))
            seen(found)
        return found

    def _later(self, trial: Trial) -> tuple[Outcome, Outcome]:
        """In as many frames after the stretch: of a trial, and of the unchanged settings."""
        if trial.method not in self.known_later:
            self.known_later[trial.method] = self._outcome(replace(trial, value=trial.before), None, later=True)
        return self._outcome(trial, None, later=True), self.known_later[trial.method]

    def _outcome(self, trial: Trial, seed: int | None, *, later: bool = False) -> Outcome:
        config = config_of(trial, self.playback.config)
        fork = self.playback.forked(self.first, (trial.method,), config, self.snapshot)
        if seed is not None:
            fork.sequence = with_noise(fork.sequence, seed)
        doing = f"rerunning the stretch with {trial.option}"
        last = min(2 * self.last - self.first + 1, len(fork.sequence) - 1) if later else self.last
        counted = range(self.last + 1 if later else self.first, last + 1)
        recorder, steps = EventRecorder(), list[tuple[int, Step]]()
        for e in _played(fork, last, doing, self.advance):
            if self.judged:
                recorder.add(e)
            if e.index in counted:
                steps += ((e.index, step) for step in e.steps if step.method == trial.method)
        alarms = (e.kind for e in recorder.log.events if e.severity.alarming and e.method == trial.method)
        return Outcome.of(steps, alarms, self._error_m(fork, trial.method) if self.judged else None)

    def _error_m(self, fork: Playback, method: str) -> float | None:
        """The absolute trajectory error from the first frame to where the fork stands, aligned as in the run's metrics;
        None without ground truth, or with too few poses."""
        sequence = fork.sequence
        found = fork.finish().trajectories.get(method) if sequence.truth is not None else None
        if sequence.truth is None or found is None:
            return None
        part = found.select(found.times_ns >= sequence.times_ns[self.first])
        error = error_against_truth(
            part, sequence.truth, sequence.rig, alignment_of(registered(method).unit == "metric")
        )
        return None if error is None else error.ate_m


def config_of(trial: Trial, run: Config) -> Config:
    """Returns the settings of a run with this one changed."""
    return run.with_settings(trial.method, replace(run.of(trial.method), **{trial.name: trial.value}))


def _played(playback: Playback, last: int, doing: str, advance: Advance) -> Iterator:
    """Its events up to a frame. Raises _Late."""
    while playback.position <= last:
        if not advance(f"{doing}, frame {playback.position}"):
            raise _Late
        yield playback.step()


def _difference(run: list[MethodRow], rerun: list[MethodRow]) -> str:
    """A sentence where the rerun is not the run; empty where it is, to the last bit."""
    thinned = {(row.exposure, row.method) for row in run if FOLLOWED not in row.values}
    made = [without_points(row) if (row.exposure, row.method) in thinned else row for row in rerun]
    found = next(divergences(run, made, tuple({row.method for row in run})), None)
    if found is None:
        return ""
    return (
        f"The rerun is not the run: {min(found.names)} differs at frame {found.exposure}, by other images, another "
        "version or another machine. Settings are compared with the rerun."
    )


def with_noise(sequence: Sequence, seed: int) -> Sequence:
    """Returns the sequence with a little noise on its images, always the same for a seed."""

    def load(i: int) -> Measurement:
        measured = sequence.load(i)
        if not isinstance(measured, Frame):
            return measured
        rng = np.random.default_rng((seed, i))
        return replace(measured, images={name: _noisy(image, rng) for name, image in measured.images.items()})

    return replace(sequence, load=load)


def _noisy(image: Image, rng: np.random.Generator) -> Image:
    noise = rng.integers(-NOISE, NOISE, image.shape, np.int16, endpoint=True)
    return np.clip(image + noise, 0, 255).astype(np.uint8)
