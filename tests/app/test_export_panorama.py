"""`ispom export --format panorama`: the images of a run in one, or a reason why not."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_file import RunFile

from ispom.geometry import Pose
from ispom.io.rig import rig_text
from ispom.io.trajectories import tum_text
from ispom.sequences import open_sequence
from ispom.types import Trajectory
from tests.sequences.kitti_folder import HEIGHT, WIDTH, make_drive


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run over six pairs, each rotated by 10 degrees."""
    drive, folder = make_drive(tmp_path / "kitti"), tmp_path / "run"
    sequence = open_sequence(str(drive))
    folder.mkdir()
    options = {"frame": "rig", "stereo_every": 1, "video_scale": 1.0, "seed": 0, "max_exposures": None}
    (folder / "run.yaml").write_text(RunFile(str(drive), "drive", options, {}).text)
    (folder / "rig.yaml").write_text(rig_text(sequence.rig))
    times_ns = np.unique(sequence.times_ns).tolist()
    poses = [(t, Pose.from_rotvec(np.radians([0.0, 10.0 * i, 0.0]), np.zeros(3))) for i, t in enumerate(times_ns)]
    (folder / "direct.tum").write_text(tum_text(Trajectory.of(poses, "rig")))
    return folder


def test_the_images_are_joined_by_their_orientations(run: Path) -> None:
    assert main(["export", str(run), "--format", "panorama"]) == 0
    panorama = cv2.imread(str(run / "export" / "panorama" / "direct.png"))
    assert panorama is not None
    height, width = panorama.shape[:2]
    view_deg = [2 * np.degrees(np.arctan(0.5 * side / 80)) for side in (WIDTH, HEIGHT)]
    assert width == pytest.approx((view_deg[0] + 50) / 360 * 2048, abs=12)
    assert height == pytest.approx(view_deg[1] / 360 * 2048, abs=12)


def test_without_the_images_there_is_a_sentence_and_no_folder(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(run.parent / "kitti")
    assert main(["export", str(run), "--format", "panorama"]) == 2
    assert "images of the run" in capsys.readouterr().err
    assert not (run / "export").exists()
