"""The page of a judgement: its misfit over time, what speaks against the poses, and how to see it on the stage."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ispom.evaluation.judge.judgement import Judgement
from ispom.sequences.address import without_secrets

from ...engine.options import SourceOptions
from ...engine.outputs import write_file
from ...presentation.templating import environment
from ..report.html import PACKAGE as REPORT
from ..report.html import POLICY, own_text
from .options import Judge
from .text import Judged, denied_text, of_all_poses, verdict

PACKAGE = __name__.rpartition(".")[0]
GENERATOR = "ISPOM judge"
"""Text in a file by which our own files are recognised."""
WIDTH, HEIGHT = 960, 280
LEFT, RIGHT, TOP, BOTTOM = 52, 936, 12, 250
"""Edges of the axes within the plot [px]."""
LEAST, MOST = 0.1, 1000.0
"""Misfits [standard deviations] that the plot can show; others are at its border."""
MARKS = 6
"""Times that are written below the plot."""


def write_page(file: Path, found: Judged, command: str) -> None:
    """Writes the page; InputError where the file is not ours, or cannot be written."""
    write_file(file, page(found, command), GENERATOR)


def page(found: Judged, command: str) -> str:
    """Returns the page, which needs no network and no script."""
    return (
        environment(PACKAGE, REPORT)
        .get_template("judge.html")
        .render(
            policy=POLICY,
            generator=GENERATOR,
            css=own_text("page.css"),
            title=f"{Path(found.poses).name} in {found.recording}",
            verdict=verdict(found),
            findings=[*of_all_poses(found), *(denied_text(found, each) for each in found.of.denied)],
            plot=plot(found),
            width=WIDTH,
            height=HEIGHT,
            open=command,
        )
    )


def plot(found: Judged) -> dict[str, Any]:
    """Returns what is drawn: spans, levels, times and pairs, in pixels."""
    shown = [each.sigmas for each in found.of.misfits]
    top = float(np.clip(max([10.0, *shown]), 10.0, MOST))
    duration = found.second(len(found.times_ns) - 1) or 1.0

    def across(frame: float) -> float:
        second = float(np.interp(frame, np.arange(len(found.times_ns)), found.times_ns - found.times_ns[0])) * 1e-9
        return round(LEFT + (RIGHT - LEFT) * second / duration, 1)

    def up(sigmas: float) -> float:
        share = np.log(np.clip(sigmas, LEAST, top) / LEAST) / np.log(top / LEAST)
        return round(BOTTOM - (BOTTOM - TOP) * float(share), 1)

    spans = [
        {"x": across(each.first), "width": max(2.0, round(across(each.last) - across(each.first), 1)), "text": text}
        for each in found.of.denied
        for text in [denied_text(found, each)]
    ]
    levels = [{"y": up(each), "text": f"{each:g}"} for each in (0.1, 1.0, 10.0, 100.0, 1000.0) if each <= top]
    seconds = [
        {"x": round(LEFT + (RIGHT - LEFT) * n / (MARKS - 1), 1), "text": f"{duration * n / (MARKS - 1):.1f}"}
        for n in range(MARKS)
    ]
    pairs = [
        {
            "first": across(each.first), "second": across(each.second), "y": up(each.sigmas),
            "text": f"frames {each.first} and {each.second}: {each.sigmas:.2g} standard deviations",
        }
        for each in found.of.misfits
    ]  # fmt: skip
    return {
        "spans": spans, "levels": levels, "seconds": seconds, "pairs": pairs,
        "left": LEFT, "right": RIGHT, "top": TOP, "bottom": BOTTOM,
    }  # fmt: skip


def worst_frame(judgement: Judgement) -> int:
    """Returns the frame of the main camera to look at: in the place that is denied most clearly, else in the pair that
    fits worst."""
    motion = [each for each in judgement.denied if each.kind == "motion"] or list(judgement.denied)
    if motion:
        worst = max(motion, key=lambda each: abs(each.size))
        first, last = worst.within or (worst.first, worst.last)
        return (first + last) // 2
    if not judgement.misfits:
        return 0
    pair = max(judgement.misfits, key=lambda each: each.sigmas)
    return (pair.first + pair.second) // 2


def opening(options: Judge, frame_of_poses: str, place: int) -> str:
    """Returns the command that opens the recording at a place among its measurements, with the path of the poses."""
    poses = f"poses:{frame_of_poses}={Path(options.poses).absolute()}"
    words = [
        "ispom",
        "app",
        without_secrets(options.recording),
        *_flags(options),
        "--at",
        str(place),
        "--beside",
        poses,
    ]
    return shlex.join(words)


def _flags(options: Judge) -> Iterator[str]:
    """The options of the recording that are not their defaults."""
    for field in fields(SourceOptions):
        value = getattr(options, field.name)
        if value == field.default:
            continue
        name = field.name.replace("_", "-")
        if isinstance(value, bool):
            yield f"--{'' if value else 'no-'}{name}"
        elif isinstance(value, tuple):
            yield from (f"--{name}", *map(str, value))
        else:
            yield from (f"--{name}", str(value))
