"""rig.yaml: what is written is read back, and mistakes are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.rig import read_rig, rig_text
from ispom.types import Camera, CameraSensor, GnssAntenna, Imu, LaserScanner, LensSigma, PairSigma, Rig, WheelOdometer
from tests import doubles


@pytest.mark.parametrize("rig", [doubles.rig(), Rig.single(Camera(64, 48, 50.0, 51.0, 31.5, 23.5, line_delay_s=3e-5))])
def test_a_rig_is_read_back(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(rig_text(rig))
    found = read_rig(tmp_path / "rig.yaml")
    assert (found.video, found.left, found.right) == (rig.video, rig.left, rig.right)
    for name in ("video", "left", "right"):
        np.testing.assert_allclose(found.rig_from(name).matrix, rig.rig_from(name).matrix, atol=1e-15)


def test_how_sure_it_is_is_read_back_and_mistakes_of_it_are_named(tmp_path: Path) -> None:
    path, pair = tmp_path / "rig.yaml", PairSigma(0.1, 0.02, 1e-4, 0.003, 2e-4, 0.0)
    path.write_text(rig_text(doubles.rig().changed(video_sigma=LensSigma(1e-3, 0.0), pair_sigma=pair)))
    found, text = read_rig(path), path.read_text()
    assert (found.video_sigma, found.pair_sigma) == (LensSigma(1e-3, 0.0), pair)
    for old, new, message in (
        ("turn_deg: 0.02", "turn_deg: -1", r"pair_sigma\.turn_deg is -1, give a value from 0 to 2"),
        ("turn_deg: 0.02", "turn_deg: 1e300", r"pair_sigma\.turn_deg is 1e\+300, give a value from 0 to 2"),
        ("focal: 0.001", "focal: 0.2", r"video_sigma\.focal is 0\.2, give a value from 0 to 0\.1"),
        ("turn_deg: 0.02", "turn_deg: .inf", r"pair_sigma\.turn_deg needs 1 finite number"),
        ("turn_deg: 0.02", "roll_deg: 1", r"pair_sigma must hold offset_px, turn_deg, .*, and no others"),
        ("video_sigma:\n  focal: 0.001\n  radial: 0.0\n", "video_sigma: 3\n", r"video_sigma must hold focal, radial"),
    ):
        assert text.count(old) == 1
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=message):
            read_rig(path)


def test_a_laser_is_read_back_and_mistakes_of_it_are_named(tmp_path: Path) -> None:
    path, pose = tmp_path / "rig.yaml", Pose.from_rotvec(np.array([0.1, 0.2, -0.3]), np.array([1.0, 2.0, 3.0]))
    path.write_text(rig_text(doubles.rig().changed(laser=LaserScanner(rig_from_sensor=pose))))
    found = read_rig(path).rig_from_laser
    assert found is not None
    np.testing.assert_allclose(found.matrix, pose.matrix, atol=1e-12)
    path.write_text(path.read_text().replace("rig_from_laser", "somewhere"))
    with pytest.raises(InputError, match=r"laser\.rig_from_laser is missing"):
        read_rig(path)
    path.write_text("laser: {rig_from_laser: {translation_m: [0, 0, 0], rotation_xyzw: [0, 0, 0, 1]}}\n")
    with pytest.raises(InputError, match="video, left or right"):
        read_rig(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx: 60.0", "fx: -60.0", r"video\.fx is -60, not positive"),
        ("fx: 60.0", "fx: .nan", r"video\.fx needs 1 finite"),
        ("fx: 60.0", "fx: wide", r"video\.fx needs 1 finite"),
        ("rig_from_video:", "somewhere:", "rig_from_video is missing"),
        (
            "distortion:",
            "distorsion:",
            r"video\.distorsion is not known, as a camera has model, .*, rig_from_video: cor",
        ),
        ("video:", "middle:", "video, left or right"),
        ("video:", "video: [", "line 3 is not valid YAML"),
        ("video:", "video: !!python/object/apply:os.getcwd", "not valid YAML"),
    ],
)
def test_a_mistake_is_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(rig_text(Rig.of(video=doubles.rig().video)).replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        read_rig(path)
    assert str(path) in str(caught.value)


SENSORS = {
    "front": CameraSensor(camera=Camera(64, 48, 50.0, 51.0, 31.5, 23.5), rig_from_sensor=Pose(translation=np.ones(3))),
    "gnss_back": GnssAntenna(rig_from_sensor=Pose(translation=np.array([0.0, -1.0, 0.0]))),
    "imu": Imu(gyroscope_noise=2e-4),
    "wheel": WheelOdometer(distance_noise=0.03),
    "laser": LaserScanner(range_noise_m=0.005),
}


def test_other_sensors_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(rig_text(doubles.rig().changed(**SENSORS)))
    found = read_rig(path)
    assert set(found.sensors) == {"video", "left", "right", *SENSORS}
    for name, sensor in SENSORS.items():
        again = found.sensors[name]
        np.testing.assert_allclose(again.rig_from_sensor.matrix, sensor.rig_from_sensor.matrix, atol=1e-12)
        assert replace(again, rig_from_sensor=sensor.rig_from_sensor).__dict__ == sensor.__dict__


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sensor: imu", "sensor: sonar", "sensors that name their kind in `sensor`"),
        ("gnss_back:", "Gnss back:", "sensors that name their kind"),
        ("gnss_back:", "world:", "sensors that name their kind"),
        ("rig_from_gnss_back", "rig_from_gnss", r"gnss_back\.rig_from_gnss_back is missing"),
        ("gyroscope_noise", "noise", r"imu\.noise is not known, as it has rig_from_imu, gyroscope_noise"),
        ("gyroscope_noise: 0.0002", "gyroscope_noise: -1", r"imu\.gyroscope_noise is -1, give a value from"),
        ("gyroscope_noise: 0.0002", "gyroscope_noise: often", r"imu\.gyroscope_noise needs 1 finite number"),
        ("sensor: camera", "sensor: imu", r"front\.width is not known"),
    ],
)
def test_mistakes_of_other_sensors_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path, text = tmp_path / "rig.yaml", rig_text(doubles.rig().changed(**SENSORS))
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        read_rig(path)
