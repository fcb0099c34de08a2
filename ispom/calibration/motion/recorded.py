"""The video camera's place and clock from how the cameras of a recording moved, without a target.

The stereo and the monocular estimator run over the recording, their motions give place and clock (hand-eye), and the
integrated estimator refines both by the images' own points, in parts of the recording that must agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.calibration.filmed.detecting import Bar, no_bar
from ispom.calibration.motion.combine import Combined, Part, combined
from ispom.calibration.motion.course import STILL_RAD, Course, Start, start_of
from ispom.calibration.motion.hand_eye import HandEye, hand_eye
from ispom.calibration.result import Redo
from ispom.ensemble import Ensemble, build
from ispom.errors import InputError
from ispom.estimators.modern.integrated.estimator import ModernIntegratedConfig
from ispom.io.files import exists, expanded
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.sequences.formats.described import filmed_rig, looks_described
from ispom.types import Rig, Sequence, Step, Trajectory

METHODS = ("monocular", "stereo")
USED = (*METHODS, "integrated")
"""What runs, and has to be compiled before."""
PART_PAIRS = 15
"""Stereo pairs of a part, at least: the integration has its window of five full and the video its map."""
MOST_PARTS = 4
PRIOR_DEG, PRIOR_M, PRIOR_S = 2.0, 0.2, 0.02
"""What the integration may correct of the hand-eye's values."""


@dataclass(frozen=True, eq=False)
class FromMotion:
    """What was found."""

    sequence: Sequence
    rig: Rig
    """As it was given, with the video camera in its place."""
    rough: HandEye
    """By the trajectories alone."""
    found: Combined
    """Refined; the values that count."""
    motions: int
    """Of the stereo pair, from pose to pose."""


def recording_of(paths: tuple[Path, ...]) -> Sequence:
    """Returns the recording, its video camera without a place. Raises InputError for a source without both cameras."""
    if len(paths) != 1:
        raise InputError(f"--from-motion takes one recording of all three cameras, not {len(paths)}: give one")
    sequence = open_sequence(str(paths[0]), placed=False, sensors=None)
    if sequence.rig.video is None or not sequence.rig.has_stereo:
        raise InputError(f"{paths[0]} has not both a video camera and a stereo pair: give a recording of all")
    return sequence


def moved_rig(sequence: Sequence, path: Path, clock_within_s: float, bar: Bar = no_bar) -> FromMotion:
    """Runs everything over the recording that was opened from a path.

    `clock_within_s`: largest clock offset of the video that is looked for. Raises Redo where the motion does not
    suffice.
    """
    left, video, joined = _courses(sequence, bar)
    start = _started(left, video, clock_within_s)
    rough = hand_eye(left, video, joined, start)
    if rough is None:
        raise Redo("the two trajectories have too little in common: film for longer, where both cameras see enough")
    parts = _refined(sequence, rough, bar)
    found = combined(rough, parts)
    rig_from_video = sequence.rig.rig_from_left @ found.video_from_left.inverse()
    path = expanded(path)
    filmed = filmed_rig(path, placed=False) if exists(path) and looks_described(path) else sequence.rig
    return FromMotion(sequence, filmed.changed(rig_from_video=rig_from_video), rough, found, len(left) - 1)


def _started(left: Course, video: Course, most_s: float) -> Start:
    start = start_of(left, video, most_s) if len(video) >= 4 else None
    if start is None:
        raise Redo("the two trajectories have too little time in common: film with all cameras for longer")
    if start.turned_rad < STILL_RAD:
        turned = np.degrees(start.turned_rad)
        raise Redo(
            f"the rig hardly turned ({turned:.2f} degrees from one stereo pair to the next), so that neither the video "
            "camera's place, nor its rotation, nor its clock is determined: turn it about two axes while it moves"
        )
    if not start.together:
        raise Redo(
            f"video and stereo do not turn alike at any clock offset within {most_s:g} s "
            f"({100 * start.unexplained:.0f} % of the motion differs): give recordings of one session, of cameras "
            "fixed to each other, or a larger --clock-within"
        )
    return start


def _courses(sequence: Sequence, bar: Bar) -> tuple[Course, Course, NDArray[np.bool_]]:
    """world_from_left and world_from_video by their own estimators; and which stereo poses are joined to the next."""
    found, breaks = _run(build(Config(), METHODS, sequence.rig), sequence, bar)
    stereo = found["stereo"].moved(right=sequence.rig.rig_from_left, frame="left")
    left, video = Course.of(_from(stereo, sequence)), Course.of(_from(found["monocular"], sequence))
    if len(left) < 3 or len(video) < 4:
        lost = "stereo" if len(left) < 3 else "monocular"
        raise Redo(f"the {lost} estimator finds no motion: film a textured scene, in focus, while the rig moves")
    joined = np.ones(len(left) - 1, bool)
    zero = sequence.times_ns[0]
    for time_ns in breaks:
        at = (time_ns - zero) * 1e-9
        joined &= ~((left.times_s[:-1] < at) & (left.times_s[1:] >= at))
    return left, video, joined


def _from(trajectory: Trajectory, sequence: Sequence) -> Trajectory:
    """Times from the sequence's beginning: seconds since 1970 leave no digits for microseconds."""
    return replace(trajectory, times_ns=trajectory.times_ns - sequence.times_ns[0])


def _refined(sequence: Sequence, rough: HandEye, bar: Bar = no_bar) -> list[Part]:
    """What the integration says about the rig in each part of the recording."""
    place = sequence.rig.rig_from_left @ rough.video_from_left.inverse()
    moved = sequence.with_video_later(rough.offset_s)
    rig = sequence.rig.changed(rig_from_video=place)
    config = Config(
        {
            "integrated": ModernIntegratedConfig(
                estimate_rig=True,
                estimate_clock=True,
                rig_sigma_deg=PRIOR_DEG,
                rig_sigma_m=PRIOR_M,
                clock_sigma_s=PRIOR_S,
            )
        }
    )
    pairs = np.flatnonzero(np.array(moved.kinds) == "stereo")
    count = int(np.clip(len(pairs) // PART_PAIRS, 1, MOST_PARTS))
    edges = [0, *(int(part[0]) for part in np.array_split(pairs, count)[1:]), len(moved)]
    out = []
    for k in range(count):
        ensemble = build(config, ("integrated",), rig)
        state = _state(ensemble, moved, edges[k], edges[k + 1], bar, f"refining, part {k + 1} of {count}")
        window = state["integrated"].window
        if window.rig_estimates:
            out.append(Part.of(window.rig, window.rig_estimates[-1].information, window.calibrated))
    return out


def _run(ensemble: Ensemble, sequence: Sequence, bar: Bar) -> tuple[dict[str, Trajectory], list[int]]:
    """Trajectories, and the times at which a method started again."""
    breaks: list[int] = []

    def look(steps: tuple[Step, ...]) -> None:
        breaks.extend(step.segment_from_ns for step in steps if step.restarted)

    state = _state(ensemble, sequence, 0, len(sequence), bar, "following the cameras", look)
    return ensemble.finish(state), breaks


def _state(
    ensemble: Ensemble,
    sequence: Sequence,
    first: int,
    end: int,
    bar: Bar,
    what: str,
    look: Callable[[tuple[Step, ...]], None] = lambda _: None,
) -> dict[str, Any]:
    state = ensemble.start()
    if sequence.prepare is not None:
        sequence.prepare(first)
    with bar(what, end - first) as step:
        for i in range(first, end):
            state, steps = ensemble.step(state, sequence[i])
            look(steps)
            step()
    return state
