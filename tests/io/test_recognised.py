"""Calibrations of any program, recognised by their content; converted there and back to 1e-9."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.files import rig_files
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.io.rig import rig_text
from ispom.types import EXACT_PAIR, Camera, Imu, LaserScanner, LensSigma, Rig

LEFT = Camera(752, 480, 458.654321987, 457.296, 367.215, 248.375, (-0.28340811, 0.07395907, 1.9359e-4, 1.76187114e-5))
VIDEO = Camera(640, 480, 452.0, 455.0, 322.3, 237.1, (-0.22, 0.06, 0.0006, -0.0004))
RIG = Rig.of(
    video=VIDEO, left=LEFT, right=LEFT,
    rig_from_video=Pose.from_rotvec(np.array([0.02, -0.03, 0.01]), np.array([0.01, -0.045, 0.03])),
    rig_from_left=Pose(translation=np.array([-0.055, 0, 0])),
    rig_from_right=Pose.from_rotvec(np.array([0.0, 0.003, 0.001]), np.array([0.055, 0, 0])),
)  # fmt: skip
REFERENCE = Path(__file__).parents[2].parent / "shared" / "data" / "calibration"


def alike(one: Rig, other: Rig) -> bool:
    """Cameras, and their places seen from the left one, to 1e-9."""
    for name in ("left", "right", "video"):
        a, b = one.camera(name), other.camera(name)
        values = [[c.width, c.height, c.fx, c.fy, c.cx, c.cy, *c.distortion] for c in (a, b)]
        poses = [rig.rig_from_left.inverse() @ rig.rig_from(name) for rig in (one, other)]
        if np.abs(np.subtract(*values)).max() > 1e-9 or np.abs(poses[0].matrix - poses[1].matrix).max() > 1e-9:
            return False
    return True


@pytest.mark.parametrize("form", ["rig", "kalibr", "euroc", "opencv"])
def test_a_rig_is_converted_there_and_back(tmp_path: Path, form: str) -> None:
    own, there, back = tmp_path / "rig.yaml", tmp_path / "there", tmp_path / "back.yaml"
    own.write_text(rig_text(RIG))
    path = there if form == "euroc" else there.with_suffix(".yaml")
    assert main(["calibrate", "convert", str(own), "--out", str(path), "--format", form]) == 0
    assert main(["calibrate", "convert", str(path), "--out", str(back)]) == 0
    assert alike(RIG, one_rig((back,))[0])


def test_our_own_format_keeps_the_laser_and_how_sure_it_is(tmp_path: Path) -> None:
    """Where the rig's frame was that of the left camera, too, which other programs have."""
    own, back = tmp_path / "rig.yaml", tmp_path / "back.yaml"
    laser = Pose.from_rotvec(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6]))
    at_left = RIG.changed(rig_from_left=Pose(), rig_from_right=RIG.rig_from_left.inverse() @ RIG.rig_from_right)
    for rig in (RIG, at_left):
        stated_rig = rig.changed(
            laser=LaserScanner(rig_from_sensor=laser), video_sigma=LensSigma(1e-3, 2e-3), pair_sigma=EXACT_PAIR
        )
        own.write_text(rig_text(stated_rig))
        assert main(["calibrate", "convert", str(own), "--out", str(back)]) == 0
        found = one_rig((back,))[0]
        assert (found.video_sigma, found.pair_sigma) == (stated_rig.video_sigma, stated_rig.pair_sigma)
        assert found.rig_from_laser is not None
        seen = [r.rig_from_left.inverse() @ (r.rig_from_laser or Pose()) for r in (stated_rig, found)]
        np.testing.assert_allclose(seen[0].matrix, seen[1].matrix, atol=1e-9)
        back.unlink()


def test_the_chain_of_kalibr_has_the_place_of_the_imu(tmp_path: Path) -> None:
    """As OpenVINS needs it: imu_from_camera, or its inverse."""
    rig_from_imu = Pose.from_rotvec(np.array([0.3, -1.2, 0.4]), np.array([0.02, -0.05, 0.1]))
    path = tmp_path / "camchain.yaml"
    path.write_text(rig_files(RIG.changed(imu=Imu(rig_from_sensor=rig_from_imu)), "kalibr")["camchain.yaml"])
    content = yaml.safe_load(path.read_text())
    for name, camera in (("cam0", "left"), ("cam1", "right"), ("cam2", "video")):
        expected = RIG.rig_from(camera).inverse() @ rig_from_imu
        np.testing.assert_allclose(content[name]["T_cam_imu"], expected.matrix, atol=1e-12)
    assert alike(RIG, one_rig((path,))[0])


@pytest.mark.parametrize("form", ["camera", "kalibr", "euroc", "opencv", "ros", "colmap"])
def test_a_camera_of_any_format_is_read(tmp_path: Path, form: str) -> None:
    for name, text in rig_files(Rig.single(VIDEO), form).items():  # type: ignore[arg-type]
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        assert one_camera(path)[0].fx == pytest.approx(VIDEO.fx, abs=1e-9)
        assert one_camera(path)[0].distortion == pytest.approx(VIDEO.distortion, abs=1e-9)


def test_several_cameras_without_poses_are_refused(tmp_path: Path) -> None:
    for name, text in rig_files(RIG, "ros").items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match="3 cameras"):
        one_rig((tmp_path,))[0]


def test_what_is_no_calibration_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("a: 1\n")
    assert main(["calibrate", "convert", str(path), "--out", str(tmp_path / "o.yaml")]) == 2
    assert "no calibration" in capsys.readouterr().err
    assert main(["calibrate", "convert", str(path)]) == 2
    assert "--out is missing" in capsys.readouterr().err


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="../shared/data/calibration is not there")
def test_files_of_other_programs_make_a_rig(tmp_path: Path) -> None:
    folder = REFERENCE / "aprilgrid_stereo" / "reference"
    files = [str(folder / f"euroc_cam{n}_sensor.yaml") for n in (0, 1)]
    out = tmp_path / "rig.yaml"
    assert main(["calibrate", "convert", *files, "--out", str(out)]) == 0
    assert one_rig((out,))[0].has_stereo
