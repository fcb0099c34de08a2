"""A diagnosis in words and as JSON."""

from __future__ import annotations

from typing import Any

from ispom.errors import counted
from ispom.evaluation.doctor.finding import Diagnosis, Ranked

from .stretch import Stretch

SHOWN = 5
"""Suspects that a person sees."""


def lines(found: Diagnosis, stretch: Stretch) -> list[str]:
    """Returns the answer, its remedy, the next suspects, and what was not tested."""
    event = stretch.event
    why = f"frame {stretch.at}" if event is None else f"the worst event there, at frame {event.frame}: {event.sentence}"
    text = [f"Frames {stretch.first} to {stretch.last}, for {why}", found.answer]
    if found.causes:
        text.append(f"What to do: {found.causes[0].suspect.remedy}")
        text += [_frames(found.causes[0])] if found.causes[0].finding.frames else []
    text += [f"  {i}. {line(each)}" for i, each in enumerate(found.ranked[:SHOWN], 1)]
    if found.silent:
        text.append(f"The recording says nothing about: {', '.join(found.silent)}.")
    if found.left:
        text.append(f"No time was left for: {', '.join(found.left)}. Give more --seconds.")
    return text


def line(each: Ranked) -> str:
    """Returns one row of the ranking."""
    state = "found" if each.finding.found else "not found"
    return f"{each.suspect.key} ({state}, strength {each.finding.strength:.2f}): {each.finding.evidence}"


def _frames(each: Ranked) -> str:
    return f"Look at {counted(len(each.finding.frames), 'frame')}: {', '.join(map(str, each.finding.frames))}."


def plain(found: Diagnosis, stretch: Stretch) -> dict[str, Any]:
    """Returns what doctor.json holds."""
    return {
        "first": stretch.first,
        "last": stretch.last,
        "at": stretch.at,
        "event": None if stretch.event is None else stretch.event.sentence,
        "answer": found.answer,
        "causes": [each.suspect.key for each in found.causes],
        "ranked": [
            {
                "key": each.suspect.key,
                "cause": each.suspect.name,
                "how": each.suspect.how,
                "found": each.finding.found,
                "strength": each.finding.strength,
                "evidence": each.finding.evidence,
                "values": dict(each.finding.values),
                "frames": list(each.finding.frames),
                "remedy": each.suspect.remedy,
            }
            for each in found.ranked
        ],
        "silent": list(found.silent),
        "left": list(found.left),
    }
