"""What is asked: whether the images of a recording contradict poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.evaluation.judge.evidence import gathered
from ispom.evaluation.judge.judgement import judge as judged
from ispom.evaluation.judge.poses import UNCHANGED, Change, changed, covered, distinct
from ispom.evaluation.judge.tracks import main_camera, main_frames
from ispom.io.kitti import read_times
from ispom.io.poses.dialect import ROW_NS, TrajectoryFile
from ispom.io.poses.recognised import read_trajectory
from ispom.types import Sequence, Trajectory

from ..evaluation.evaluated import frame_of
from .options import FrameOfPoses
from .text import Judged


@dataclass(frozen=True, eq=False)
class Question:
    """Poses, and whose they are."""

    file: TrajectoryFile
    of_rig: bool
    """Whether they are those of the rig, else of the main camera."""

    @staticmethod
    def of_files(poses: Path, frame: FrameOfPoses, times: Path | None) -> Question:
        """Reads the poses. Raises InputError where they are none, or have no rotations."""
        file = read_trajectory(poses, None if times is None else read_times(times))
        if not file.has_rotations:
            raise InputError(
                f"{file.path} has positions only, and images cannot judge those alone: give rotations as well"
            )
        return Question(file, frame_of(file) in ("body", "rig") if frame == "auto" else frame == "rig")

    def answer(self, sequence: Sequence, recording: str, advance: Callable[[], None]) -> Judged:
        """Judges the poses by the images. Raises InputError for poses of another recording. `advance` is called after
        each frame of the main camera, and may raise to end it."""
        places = main_frames(sequence)
        times_ns = sequence.times_ns[places]
        poses, frame = poses_of(self.file, times_ns), self.camera_in(sequence)
        has_pose = covered(poses, times_ns)
        if not has_pose.any():
            raise InputError(
                f"no frame of {recording} has a pose in {self.file.path} near its time: give poses of this recording"
            )
        evidence = gathered(sequence, places, changed(poses, times_ns, frame), has_pose, advance)
        found = judged(evidence, poses, times_ns, has_pose, frame)
        return Judged(found, times_ns, str(self.file.path), sequence.name)

    def camera_in(self, sequence: Sequence) -> Change:
        """Returns how the main camera stands in the frame of the poses."""
        if not self.of_rig:
            return UNCHANGED
        rig_from_camera = sequence.rig.rig_from(main_camera(sequence))
        return Change(mount=rig_from_camera.rotation, lever=rig_from_camera.translation)


def require_images(sequence: Sequence, recording: str) -> None:
    """Raises InputError where it has no frames, or no calibration."""
    if not sequence.rig.cameras or not len(main_frames(sequence)):
        raise InputError(f"{recording} has no frames of a camera: give a recording with images")
    if sequence.guess is not None:
        raise InputError(
            f"{recording} has no calibration, and a guessed one contradicts right poses: give one by --camera"
        )


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
