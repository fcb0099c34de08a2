"""Trajectories of other programs: aligned as stated, and known at frames, but never where they say nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.external_trajectories.placed import ExternalTrajectory
from ispom_app.engine.playback import truth_from_start
from numpy.testing import assert_allclose

from ispom.errors import InputError
from ispom.types import Trajectory
from tests import doubles
from tests.app.run.external_trajectories.made import elsewhere, external, written

SEQUENCE = doubles.sequence(60)


def truth() -> Trajectory:
    found = truth_from_start(SEQUENCE)
    assert found is not None
    return found


def ate_m(found: ExternalTrajectory, until_ns: int = 2**62) -> float:
    error = found.error(truth(), SEQUENCE.rig, until_ns)
    assert error is not None
    return error.ate_m


def test_another_world_is_aligned_to_the_ground_truth(tmp_path: Path) -> None:
    placed = external(SEQUENCE, written(tmp_path / "a.tum", elsewhere(SEQUENCE)))
    found = placed.of_truth
    assert found is not None
    assert_allclose(found.positions, truth().translations, atol=1e-6)
    assert_allclose(found.rotations, truth().rotations, atol=1e-6)
    assert ate_m(placed) < 1e-6 and not found.missing(40)
    assert placed.error(truth(), SEQUENCE.rig, int(SEQUENCE.times_ns[1])) is None, "two poses fix no alignment"
    assert "ground truth by se3" in found.alignment and f"({len(SEQUENCE)} poses)" in found.alignment


def test_another_unit_needs_sim3_and_its_scale_is_stated(tmp_path: Path) -> None:
    path = written(tmp_path / "a.tum", elsewhere(SEQUENCE, unit_m=0.25))
    with_scale, rigid = external(SEQUENCE, path, "a", "a=sim3"), external(SEQUENCE, path)
    assert with_scale.of_truth is not None and "scale 0.25" in with_scale.of_truth.alignment
    assert ate_m(with_scale) < 1e-6 and ate_m(rigid) > 0.1


def test_poses_of_a_camera_are_carried_to_the_rig(tmp_path: Path) -> None:
    left = elsewhere(SEQUENCE, right=SEQUENCE.rig.rig_from_left)
    found = external(SEQUENCE, written(tmp_path / "a.tum", left), "a:left")
    assert found.of_truth is not None and "left camera" in found.of_truth.alignment
    assert ate_m(found) < 1e-6


def test_between_two_poses_it_is_interpolated_and_in_a_gap_unknown(tmp_path: Path) -> None:
    every_second = elsewhere(SEQUENCE).select(np.arange(0, len(SEQUENCE), 2))
    gap = every_second.select(np.r_[0:10, 20 : len(every_second)])
    found = external(SEQUENCE, written(tmp_path / "a.tum", gap)).of_truth
    assert found is not None
    known = np.isfinite(found.positions[:, 0])
    assert known[:19].all() and not known[19:40].any() and known[40 : 2 * len(every_second) - 1].all()
    assert found.pose(25) is None and found.missing(50) == 21
    assert np.nanmax(found.errors_m) < 0.01, "a chord of 1/15 s"


def test_only_poses_up_to_a_time_count(tmp_path: Path) -> None:
    found = external(SEQUENCE, written(tmp_path / "a.tum", elsewhere(SEQUENCE))).of_truth
    assert found is not None
    assert [found.count(int(t)) for t in (SEQUENCE.times_ns[0] - 1, SEQUENCE.times_ns[7])] == [0, 8]


def test_of_two_poses_at_one_time_the_last_counts(tmp_path: Path) -> None:
    lines = written(tmp_path / "a.tum", elsewhere(SEQUENCE)).read_text().splitlines()
    wrong = " ".join([lines[5].split()[0], "9", "9", "9", *lines[5].split()[4:]])
    (tmp_path / "b.tum").write_text("\n".join([*lines[:5], wrong, *lines[5:]]) + "\n")
    found = external(SEQUENCE, tmp_path / "b.tum").of_truth
    assert found is not None and np.nanmax(found.errors_m) < 1e-6


def test_rows_of_a_kitti_file_are_the_images(tmp_path: Path) -> None:
    poses = elsewhere(SEQUENCE)
    rows = np.concatenate([poses.rotations, poses.translations[:, :, None]], 2).reshape(-1, 12)
    np.savetxt(tmp_path / "all.txt", rows)
    video = [i for i, kind in enumerate(SEQUENCE.kinds) if kind == "video"]
    np.savetxt(tmp_path / "video.txt", rows[video])
    for name in ("all.txt", "video.txt"):
        assert ate_m(external(SEQUENCE, tmp_path / name)) < 1e-3
    np.savetxt(tmp_path / "some.txt", rows[:30])
    with pytest.raises(InputError, match=r"30 rows .*66 images"):
        external(SEQUENCE, tmp_path / "some.txt")


def test_a_trajectory_of_another_recording_is_refused(tmp_path: Path) -> None:
    poses = elsewhere(SEQUENCE)
    later = replace(poses, times_ns=poses.times_ns + 10**12)
    with pytest.raises(InputError, match="in common"):
        external(SEQUENCE, written(tmp_path / "a.tum", later))
