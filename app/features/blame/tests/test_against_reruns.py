"""What blame says, against really leaving the tracks out and running the step again, on recordings.

`python -m pytest -m slow -s` of this file prints the table of docs/howto/blame.md.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.blame.found import pose_blames

from ispom.methods import Config
from ispom.sequences import open_sequence

DATA = Path(__file__).parents[4].parent / "shared" / "data"
CASES = {
    "KITTI 06": ("kitti/sequences/06", "stereo", 20, 5),
    "handheld_board": ("handheld_board", "monocular", 60, 12),
    "city with vehicles, stereo": ("sim:city?vehicles=8&duration_s=3", "stereo", 12, 11),
    "city with vehicles, monocular": ("sim:city?vehicles=8&duration_s=3", "monocular", 20, 6),
}
"""Source, method, first frame, and least number of frames from one to the next."""
COUNTS = {False: 4, True: 4}
"""Frames that are no keyframes, and keyframes, that are looked at of each."""
LARGEST = {"group": 5, "track": 5}
CLOSE = 0.2


class Row(NamedTuple):
    key_frame: bool
    blamed: float
    rerun: float
    apart: float
    """Of the two vectors, relative to the rerun."""


def rows(source: str, method: str, first: int, gap: int) -> Iterator[Row]:
    playback, left, due = Playback(open_sequence(source), (method,), Config()), dict(COUNTS), first
    while any(left.values()) and playback.position < len(playback.sequence):
        uses = playback.position >= due and playback.sequence.kinds[playback.position] in ("video", "stereo")
        reported = playback.reported_problems() if uses else {}
        if (
            method in reported
            and reported[method][0].world_from_frame is not None
            and left[reported[method][0].key_frame]
        ):
            key_frame = reported[method][0].key_frame
            left[key_frame] -= 1
            due = playback.position + gap
            (of,) = pose_blames(playback, (method,), {})
            for kind, count in LARGEST.items():
                for each in of.found.of(kind)[:count]:  # type: ignore[arg-type]
                    step = playback.without_tracks(method, np.array(each.part.tracks))
                    again = None if step is None else of.between(step)
                    if again is not None:
                        off = float(np.linalg.norm(each.shift.position - again.position))
                        yield Row(key_frame, each.shift.size, again.size, off / again.size)
        playback.step()


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_blame_is_within_a_fifth_of_running_the_step_again(name: str) -> None:
    source, method, first, gap = CASES[name]
    if not source.startswith("sim:"):
        if not (DATA / source).is_dir():
            pytest.skip(f"{source} is not in ../shared/data")
        source = str(DATA / source)
    found = list(rows(source, method, first, gap))
    assert len(found) >= 30
    for key_frame in (False, True):
        apart = np.array([row.apart for row in found if row.key_frame is key_frame])
        if len(apart):
            what = "keyframes" if key_frame else "other frames"
            reported = (
                f"{name} | {what} | {len(apart)} | {100 * np.median(apart):.0f} % | {(apart <= CLOSE).mean():.0%}"
            )
            sys.stdout.write(f"| {reported} |\n")
    every = np.array([row.apart for row in found])
    assert np.median(every) < CLOSE / 2 and (every <= CLOSE).mean() >= 0.9
