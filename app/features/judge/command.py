"""The command: opens poses and recording, judges, prints, and gives the exit code."""

from __future__ import annotations

import json
import sys

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, printable
from ispom.evaluation.judge.evidence import gathered
from ispom.evaluation.judge.judgement import judge as judged
from ispom.evaluation.judge.poses import UNCHANGED, Change, changed, covered, distinct
from ispom.evaluation.judge.tracks import main_camera, main_frames
from ispom.io.kitti import read_times
from ispom.io.poses.dialect import ROW_NS, TrajectoryFile
from ispom.io.poses.recognised import read_trajectory
from ispom.io.whole import write_whole
from ispom.stop import check_stop
from ispom.types import Sequence, Trajectory

from ...engine.outputs import claim_folder
from ...engine.signals import terminable
from ..evaluation.evaluated import frame_of
from ..headless.console import progress
from .options import Judge
from .page import opening, worst_frame, write_page
from .text import Judged, lines, plain

EXIT_CODES = {"agrees": 0, "contradicted": 1, "cannot tell": 3}
"""By verdict; 2 is for a mistake of the user."""


def judge(options: Judge) -> int:
    """Returns the exit code of the verdict. Raises InputError for what is wrong with the poses or the recording."""
    file = read_trajectory(options.poses, None if options.times is None else read_times(options.times))
    if not file.has_rotations:
        raise InputError(f"{file.path} has positions only, and images cannot judge those alone: give rotations as well")
    sequence = opened(options)
    places = main_frames(sequence)
    times_ns = sequence.times_ns[places]
    poses, frame = poses_of(file, times_ns), camera_in(options, file, sequence)
    has_pose = covered(poses, times_ns)
    if not has_pose.any():
        raise InputError(
            f"no frame of {options.recording} has a pose in {file.path} near its time: give poses of this recording"
        )
    with terminable(), progress(len(places)) as advance:

        def read() -> None:
            check_stop()
            advance()

        evidence = gathered(sequence, places, changed(poses, times_ns, frame), has_pose, read)
    found = Judged(judged(evidence, poses, times_ns, has_pose, frame), times_ns, str(file.path), sequence.name)
    place = int(places[worst_frame(found.of)])
    command = opening(options, main_camera(sequence) if frame is UNCHANGED else "rig", place)
    if options.out is not None:
        claim_folder(options.out, "judge")
        write_whole(options.out / "judge.json", json.dumps(plain(found), indent=2, allow_nan=False) + "\n")
    text = json.dumps(plain(found), indent=2, allow_nan=False) if options.json else "\n".join(lines(found))
    if options.page is not None:
        write_page(options.page, found, command)
    if found.of.verdict == "contradicted" and not options.json:
        text += f"\nSee it: {printable(command)}"
    sys.stdout.write(f"{text}\n")
    return EXIT_CODES[found.of.verdict]


def opened(options: Judge) -> Sequence:
    """Returns the recording. Raises InputError where it has no frames, or no calibration."""
    sequence = options.opened(options.recording)
    if not sequence.rig.cameras or not len(main_frames(sequence)):
        raise InputError(f"{options.recording} has no frames of a camera: give a recording with images")
    if sequence.guess is not None:
        raise InputError(
            f"{options.recording} has no calibration, and a guessed one contradicts right poses: give one by --camera"
        )
    return sequence


def poses_of(file: TrajectoryFile, times_ns: NDArray[np.int64]) -> Trajectory:
    """Returns the poses at different times, those of a file without times at the times (F,) of the frames."""
    poses = file.trajectory
    if not file.timed:
        rows = poses.times_ns // ROW_NS
        if (not file.numbered and len(poses) != len(times_ns)) or not 0 <= int(rows.min()) <= int(rows.max()) < len(
            times_ns
        ):
            raise InputError(
                f"{file.path} has {len(poses)} poses without times, and the recording {len(times_ns)} frames: give the "
                "times of its rows by --times"
            )
        poses = Trajectory(times_ns[rows], poses.rotations, poses.translations, poses.frame)
    return distinct(poses)


def camera_in(options: Judge, file: TrajectoryFile, sequence: Sequence) -> Change:
    """Returns how the main camera stands in the frame of the poses."""
    of_rig = frame_of(file) in ("body", "rig") if options.frame == "auto" else options.frame == "rig"
    if not of_rig:
        return UNCHANGED
    rig_from_camera = sequence.rig.rig_from(main_camera(sequence))
    return Change(mount=rig_from_camera.rotation, lever=rig_from_camera.translation)
