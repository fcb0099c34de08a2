"""The verdict on two runs, on pairs whose truth is known because they are made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from ispom_app.engine.differences.paths import Path
from ispom_app.features.runs.compared_method import MethodRun
from ispom_app.features.runs.comparison_view import ComparedRun, ComparisonView, comparison_view
from ispom_app.features.runs.stretches import FAILED

from ispom.evaluation.trajectory_error import TrajectoryError, alignment_of
from ispom.geometry import Array, Pose
from ispom.methods import method as registered
from ispom.types import Trajectory

COUNT = 160
JUMP = 21
TIMES_NS = np.arange(COUNT) * 100_000_000


def motions(count: int = COUNT) -> Iterator[Pose]:
    """A metre forwards at each frame, in curves."""
    for i in range(1, count):
        yield Pose.from_rotvec(np.array([0.0, 0.03 * np.sin(i / 20), 0.0]), np.array([0.0, 0.0, 1.0]))


def drive(seed: int | None = None, noise: float = 0.01, factor: float = 1.0) -> list[Pose]:
    """The true path, or one whose motions have noise and `factor` times their length."""
    random, poses = np.random.default_rng(seed), [Pose(np.eye(3), np.zeros(3))]
    for motion in motions():
        moved = motion
        if seed is not None:
            wrong = Pose.from_rotvec(0.1 * noise * random.standard_normal(3), noise * random.standard_normal(3))
            moved = Pose(motion.rotation, factor * motion.translation) @ wrong
        poses.append(poses[-1] @ moved)
    return poses


def jumped(poses: list[Pose], by: float) -> list[Pose]:
    """The same motions, and at frame JUMP one more."""
    shift = Pose(np.eye(3), np.array([by, 0.0, 0.0]))
    return [shift @ pose if i >= JUMP else pose for i, pose in enumerate(poses)]


def trajectory(poses: list[Pose]) -> Trajectory:
    return Trajectory.of(list(zip(TIMES_NS.tolist(), poses, strict=False)))


def run(
    poses: list[Pose], truth: list[Pose] | None, method: str = "stereo", localised: Array | None = None
) -> ComparedRun:
    frames = np.arange(len(poses))
    path = Path(frames, np.array([p.translation for p in poses]), np.array([p.xyzw for p in poses]))
    error = None
    if truth is not None:
        kind = alignment_of(registered(method).unit == "metric")
        error = TrajectoryError(trajectory(poses), trajectory(truth[: len(poses)]), kind)
    found = MethodRun(path, frames, np.ones(len(poses), bool) if localised is None else localised, error)
    return ComparedRun({method: found}, len(poses))


def compared(a: list[Pose], b: list[Pose], method: str = "stereo", **options: int) -> ComparisonView:
    truth = drive()
    return comparison_view(run(a, truth, method), run(b, truth, method), TIMES_NS, **options)


def metric(view: ComparisonView, key: str):
    return next(each for each in view.metrics if each.key == key)


def test_a_run_is_as_good_as_itself_and_parts_nowhere_from_itself() -> None:
    poses = drive(1)
    view = compared(poses, poses)
    assert (view.better, view.parting, view.frames) == ("same", None, COUNT)
    assert metric(view, "ate").better == metric(view, "located").better == "same"
    assert max(view.curves[0].values) == 0 and view.curves[0].parts_at is None


def test_paths_part_at_the_jump_and_one_jump_is_no_proof_of_a_worse_run() -> None:
    view = compared(drive(1), jumped(drive(2), 3.0))
    assert view.parting is not None and (view.parting.frame, view.parting.at_once) == (JUMP, True)
    assert view.curves[0].parts_at == JUMP
    assert view.better == metric(view, "ate").better == "cannot tell"
    first, last = metric(view, "ate").mostly or (COUNT, COUNT)
    assert first < JUMP <= last < JUMP + 10


def test_a_run_that_drifts_all_along_is_worse_and_its_path_does_not_jump() -> None:
    view = compared(drive(1), drive(2, factor=1.03))
    assert view.better == metric(view, "ate").better == "a"
    assert view.parting is not None and not view.parting.at_once and view.parting.frame < COUNT // 2
    other = compared(drive(2, factor=1.03), drive(1))
    assert other.better == "b" and other.parting is not None and other.parting.frame == view.parting.frame


def test_a_longer_run_is_compared_where_both_have_frames() -> None:
    a, b = drive(1), drive(2, factor=1.03)[:100]
    view = compared(a, b)
    assert view.frames == 100 and view.better == "a" and max(view.curves[0].frames) == 99
    assert alike(view, compared(a[:100], b))


def alike(a: ComparisonView, b: ComparisonView) -> bool:
    """Whether both say the same, but for what is known of the frames that only one has."""
    return (a.better, a.parting and a.parting.frame, a.curves) == (b.better, b.parting and b.parting.frame, b.curves)


@pytest.mark.parametrize("which", ["none", "one", "other"])
def test_without_one_and_the_same_truth_nobody_is_more_accurate(which: str) -> None:
    truth, moved = drive(), [Pose(pose.rotation, pose.translation * 1.1) for pose in drive()]
    a = run(drive(1), truth if which != "none" else None)
    b = run(drive(2, factor=1.03), {"none": None, "one": None, "other": moved}[which])
    view = comparison_view(a, b, TIMES_NS)
    assert view.better == "cannot tell" and metric(view, "ate").a == ""
    assert metric(view, "located").better == "same" and view.curves and view.parting is not None


def test_a_run_that_is_lost_half_of_the_time_is_worse() -> None:
    lost = np.arange(COUNT) // 20 % 2 == 0
    poses = drive(1)
    view = comparison_view(run(poses, drive()), run(poses, drive(), localised=lost), TIMES_NS)
    assert metric(view, "located").better == "a" == view.better
    assert metric(view, "ate").better == "same"


def test_a_stretch_without_poses_counts_as_worse_than_any_error() -> None:
    a, b = run(drive(1), drive()), run(drive(2), drive())
    error = b.methods["stereo"].error
    assert error is not None
    there = np.arange(COUNT) % 40 < 8
    part = replace(error, estimate=error.estimate.select(there), reference=error.reference.select(there))
    view = comparison_view(a, replace(b, methods={"stereo": replace(b.methods["stereo"], error=part)}), TIMES_NS)
    assert FAILED > 0 and metric(view, "ate").better in ("a", "cannot tell")


def test_a_fork_parts_after_the_frame_at_which_it_was_forked() -> None:
    view = compared(drive(1), jumped(drive(1), 0.0)[:60] + drive(1)[60:])
    assert view.parting is None
    fork = drive(1)[:60]
    for motion in list(motions())[59:]:
        fork.append(fork[-1] @ Pose(motion.rotation, 1.05 * motion.translation))
    view = compared(drive(1), fork, start=60)
    assert view.parting is not None and 60 <= view.parting.frame <= 80


def test_a_path_in_another_unit_and_world_is_brought_to_the_first() -> None:
    poses = drive(1)
    world = Pose.from_rotvec(np.array([0.1, 2.0, 0.3]), np.array([5.0, 6.0, 7.0]))
    other = [world @ Pose(pose.rotation, 0.2 * pose.translation) for pose in poses]
    view = compared(poses, other, "monocular")
    assert view.parting is None and view.curves[0].metres and max(view.curves[0].values) < 1e-6


def test_the_map_of_the_parting_has_both_paths_and_the_truth_around_it() -> None:
    place = compared(drive(1), jumped(drive(2), 3.0)).parting
    assert place is not None and set(place.paths) == {"A", "B", "truth"} and set(place.here) == {"A", "B"}
    assert len(place.paths["A"]) == 41
    away = np.linalg.norm(np.subtract(place.here["A"], place.here["B"]))
    assert 2.5 < away < 3.5


def test_runs_without_a_common_method_are_not_compared() -> None:
    view = comparison_view(run(drive(1), None), run(drive(1), None, "monocular"), TIMES_NS)
    assert view.better == "cannot tell" and not view.metrics and view.parting is None


def test_equal_runs_are_hardly_ever_called_different() -> None:
    found = [compared(drive(2 * i), drive(2 * i + 1)).better for i in range(8)]
    assert sum(verdict in ("a", "b") for verdict in found) <= 1
