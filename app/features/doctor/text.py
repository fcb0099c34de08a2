"""A diagnosis in words."""

from __future__ import annotations

from collections.abc import Sequence

from ispom.errors import counted
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Ranked
from ispom.evaluation.doctor.reruns import Outcome, Reruns
from ispom.plausibility.doubt import Doubt

from ...engine.run_events.stretch import Stretch

SHOWN = 5
"""Suspects that a person sees."""


def lines(found: Diagnosis, stretch: Stretch, notes: Sequence[str] = ()) -> list[str]:
    """Returns what was said of the recording when it was opened (doubts among `notes`), the answer, its remedy, the
    next suspects, and what was not tested."""
    event = stretch.event
    why = f"frame {stretch.at}" if event is None else f"the worst event there, at frame {event.frame}: {event.sentence}"
    known = [f"Known of the recording: {note}" for note in notes if isinstance(note, Doubt)]
    text = [*known, f"Frames {stretch.first} to {stretch.last}, for {why}", found.answer]
    if found.causes:
        text.append(f"What to do: {found.causes[0].suspect.remedy}")
        text += [_frames(found.causes[0])] if found.causes[0].finding.frames else []
    text += [f"  {i}. {line(each)}" for i, each in enumerate(found.ranked[:SHOWN], 1)]
    if found.silent:
        text.append(f"Not testable: {', '.join(found.silent)}.")
    if found.left:
        text.append(f"Not tested, no time was left: {', '.join(found.left)}. Give more --seconds.")
    return text + [row for each in (found.set_back, found.reruns) if each is not None for row in rerun_lines(each)]


def rerun_lines(reruns: Reruns) -> list[str]:
    """Returns what other settings did to the stretch: the answer and a row for each rerun."""
    text = [f"Rerun from frame {reruns.first} to {reruns.last}. {reruns.answer}"]
    for option, outcome, helps in rerun_table(reruns):
        text.append(f"  {option}: {outcome.words}{'; this helps' if helps else ''}")
    if reruns.left:
        text.append(f"Not tried: {', '.join(reruns.left)}. Give more --seconds.")
    return text


def rerun_table(reruns: Reruns) -> list[tuple[str, Outcome, bool]]:
    """Returns (what was changed, its outcome, whether that helps): of each method unchanged, then the best first."""
    found = []
    for method in dict.fromkeys(t.trial.method for t in reruns.tried):
        own = sorted((t for t in reruns.tried if t.trial.method == method), key=lambda t: -t.strength)
        unchanged = max((t.unchanged for t in own), key=len)
        noisy = [f"{len(outcome.located)}" for outcome in unchanged[1:]]
        name = f"{method} unchanged" + (f" (with noise: {', '.join(noisy)} located)" if noisy else "")
        found.append((name, unchanged[0], False))
        found += [
            (t.trial.option + (" (only delays it)" if t.only_delays else ""), t.outcomes[0], t.helps) for t in own
        ]
    return found


def line(each: Ranked) -> str:
    """Returns one row of the ranking."""
    state = f"{each.finding.state}, strength {each.finding.strength:.2f}"
    return f"{each.suspect.key} ({state}): {each.finding.evidence} {each.finding.undecided}".rstrip()


def _frames(each: Ranked) -> str:
    return f"Look at {counted(len(each.finding.frames), 'frame')}: {', '.join(map(str, each.finding.frames))}."
