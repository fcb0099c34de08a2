"""`ispom publish --failures`: ways in which visual odometry is known to fail, each a small run on a simulation with
that one fault, and what the doctor finds in it.

    data/site.bin     the list: what happens, and the frame at which each is shown
    data/NAME/        a run, as of a single published one, with the doctor's answer among its view values
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ispom.errors import printable
from ispom.methods import Config

from ....engine.playback import Builder
from ....engine.run_events.stretch import events_in, stretch_of
from ...doctor.job import examine
from ...doctor.options import FRAMES
from ...doctor.state import Examined
from ...lessons.lesson import RunRequest
from ..data import data_files
from ..review import reviewed
from ..site import packed
from .kept import KeptRun, Runs

NO_CAUSE = "no single cause found"
UNLIMITED_S = 3600.0
"""The doctor is to test everything, however slow the computer is: what is published is the same everywhere."""


@dataclass(frozen=True)
class Failure:
    name: str
    title: str
    about: str
    """What goes wrong, and why."""
    source: str
    methods: tuple[str, ...] = ("monocular", "stereo")


FAILURES = (
    Failure(
        "rotation",
        "Rotation only",
        "The camera turns and stays where it is. Near and far points move alike, so that one camera finds no depth and "
        "no map. The pair has its baseline.",
        "sim:tiny?motion=rotation",
    ),
    Failure(
        "plane",
        "One plane",
        "The camera moves along a wall, so that all points lie in one plane. More than one motion then explains the "
        "same images. The method of 2013 cannot hold its scale; the newer one can.",
        "sim:tiny?place=wall&motion=sideways",
        ("monocular.paper", "monocular"),
    ),
    Failure(
        "darkness",
        "Darkness",
        "For 0.6 s nearly no light reaches the cameras. The corners drown in the noise of the sensor, and their tracks "
        "end.",
        "sim:tiny?fault=darkness:factor=0.02,from_s=1,until_s=1.6",
    ),
    Failure(
        "shutter",
        "Rolling shutter",
        "The rows of an image are exposed one after the other, within 20 ms, and the calibration says that they are "
        "not. Each row has a pose of its own.",
        "sim:tiny?rolling_shutter_ms=20&fault=wrong-shutter",
        ("monocular.paper", "stereo.paper"),
    ),
    Failure(
        "focal",
        "Wrong focal length",
        "The focal length of the video camera is given 3 % too long. No check fails, and yet all angles are wrong.",
        "sim:tiny?fault=wrong-lens:focal_percent=3",
        ("monocular.paper", "stereo.paper"),
    ),
    Failure(
        "swapped",
        "Swapped pair",
        "The left and the right images are exchanged. Points have to lie behind the cameras, where none can be.",
        "sim:tiny?fault=exchanged",
    ),
    Failure(
        "clock",
        "Two clocks",
        "The video camera exposes 20 ms later than its time stamps say. Each sensor alone is right, and together they "
        "are not.",
        "sim:tiny?fault=clock",
        ("monocular.paper", "stereo.paper", "integrated.paper"),
    ),
    Failure(
        "object",
        "A moving object",
        "Something with texture moves to and fro before the cameras and fills a part of the image. Its motion may be "
        "taken for the camera's.",
        "sim:tiny?fault=object:width_percent=60,height_percent=70",
    ),
)


def failures_data(builder: Builder, most_bytes: float, failures: tuple[Failure, ...] = FAILURES) -> dict[str, bytes]:
    """Returns the files of the runs by name, with at most `most_bytes` together. Prints which run is being made.
    InputError as `ispom run`."""
    found, listed = dict[str, bytes](), list[dict[str, Any]]()
    with TemporaryDirectory() as place:
        runs = Runs(Path(place), (), builder)
        for number, failure in enumerate(failures, 1):
            sys.stderr.write(f"{number} of {len(failures)}: {printable(failure.title)}\n")
            run = runs.of(RunRequest(failure.source, failure.methods, Config()))
            examined = _examined(run)
            listed.append(_listed(failure, examined))
            found |= _files(failure, run, examined, most_bytes / len(failures))
    return found | {"site.bin": packed({"first": failures[0].name, "listed": listed})}


def _listed(failure: Failure, examined: Examined) -> dict[str, Any]:
    """As the page lists it, with the frame at which it opens."""
    assert examined.stretch is not None and examined.diagnosis is not None
    causes = examined.diagnosis.causes
    return {
        "name": failure.name,
        "title": failure.title,
        "about": failure.about,
        "command": f"ispom app '{failure.source}' --methods {' '.join(failure.methods)}",
        "at": examined.stretch.at,
        "answer": causes[0].suspect.name if causes else NO_CAUSE,
    }


def _files(failure: Failure, run: KeptRun, examined: Examined, most_bytes: float) -> Iterator[tuple[str, bytes]]:
    with reviewed([run.folder], [failure.name]) as review:
        shown = replace(review, state=review.state.having(examined))
        files, _ = data_files(shown, [run.folder], most_bytes)
        yield from ((f"{failure.name}/{name}", content) for name, content in files.items())


def _examined(run: KeptRun) -> Examined:
    """What `ispom doctor` says of the worst event, but for reruns with other settings: each has one fault, of which the
    recording has to speak."""
    sequence = run.kept.ran(None).sequence
    stretch = stretch_of(sequence, None, FRAMES, events_in(run.folder))
    return Examined(stretch, diagnosis=examine(sequence, stretch, UNLIMITED_S))
