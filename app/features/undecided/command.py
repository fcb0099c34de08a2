"""The command: opens a recording, or poses and a calibration, and prints a line for each stretch."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.evaluation.undecided.stretches import Answer, of_motion, of_recording
from ispom.io.calibrations.recognised import one_rig
from ispom.io.poses.recognised import read_trajectory
from ispom.io.whole import write_whole
from ispom.settings import checked
from ispom.stop import check_stop
from ispom.types import Rig, Sequence, Trajectory

from ...engine.outputs import claim_folder, csv_of, json_of, require_own, write_file
from ...engine.signals import terminable
from ..headless.console import progress
from .options import CREATOR, Undecided
from .text import lines, table
from .written import written


def undecided(options: Undecided) -> int:
    """Returns 0. Raises InputError for what is wrong with the recording, the poses or the calibration."""
    checked(options)
    if options.plot is not None and find_spec("matplotlib") is None:
        raise InputError("--plot needs Matplotlib, which is not installed: run pip install 'ispom[plots]'")
    if options.plot is not None:
        require_own(options.plot, CREATOR)
    if options.distance is None:
        name, answers = _recorded(options)
    else:
        name, answers = _planned(options, options.distance)
    if not answers:
        raise InputError(f"{options.source} has no stretch of 5 frames: give a longer recording, or longer --seconds")
    content = json_of(written(name, answers))
    if options.out is not None:
        claim_folder(options.out, "undecided")
        write_whole(options.out / "undecided.json", content)
        write_whole(options.out / "undecided.csv", csv_of(*table(answers)))
    if options.plot is not None:
        from .figure import svg  # brings matplotlib

        write_file(options.plot, svg(name, answers), CREATOR)
    sys.stdout.write(content if options.json else "\n".join(lines(name, answers)) + "\n")
    return 0


def _recorded(options: Undecided) -> tuple[str, list[Answer]]:
    sequence = calibrated(options.open(options.source), options.source)
    return sequence.name, _all(lambda step: of_recording(sequence, options.seconds, options.step, step))


def calibrated(sequence: Sequence, source: str) -> Sequence:
    """Returns it. Raises InputError where it has no camera, or no calibration of its own."""
    if sequence.rig.video is None and not sequence.rig.has_stereo:
        raise InputError(f"{source} has neither a video camera nor a pair: give a recording with images")
    if sequence.guess is not None:
        raise InputError(f"{source} has no calibration, and a guess of one is not at its minimum: give one by --camera")
    return sequence


def _planned(options: Undecided, distance: float) -> tuple[str, list[Answer]]:
    if not 0 < distance < np.inf:
        raise InputError(f"--distance is {distance:g}: give the usual distance of what the camera will see, above 0")
    if options.camera is None:
        raise InputError("a motion needs the calibration of the camera that will see it: give it by --camera")
    rig, _ = one_rig((options.camera,))
    poses = motion_of_file(options)
    return f"the motion of {options.source}", _all(lambda step: _each(step, poses, rig, distance, options))


def _each(
    step: Callable[[], None], poses: Trajectory, rig: Rig, distance: float, options: Undecided
) -> Iterator[Answer]:
    for found in of_motion(poses, rig, distance, options.seconds, options.step, options.seed):
        step()
        yield found


def motion_of_file(options: Undecided) -> Trajectory:
    """Returns the poses. Raises InputError where they have no times or no rotations."""
    file = read_trajectory(Path(options.source), None)
    if not file.has_rotations or not file.timed:
        raise InputError(f"{file.path} lacks {'times' if file.has_rotations else 'rotations'}: give poses with both")
    return file.trajectory


def _all(answers: Callable[[Callable[[], None]], Iterator[Answer]]) -> list[Answer]:
    with terminable(), progress(None) as advance:

        def step() -> None:
            check_stop()
            advance()

        return list(answers(step))
