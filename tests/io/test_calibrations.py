"""Calibrations in the formats of other programs: round trips to 1e-9, other tools' files, and what is wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ros_text
from ispom.io.calibrations.files import camera_text
from ispom.io.calibrations.kalibr import euroc_sensor_text, kalibr_text, read_euroc_sensor, read_kalibr
from ispom.io.calibrations.opencv import opencv_text, read_opencv
from ispom.io.calibrations.placed import Placed
from ispom.io.calibrations.recognised import one_camera
from ispom.io.colmap import colmap_cameras_text, read_colmap_cameras
from ispom.io.rig import read_rig, rig_text
from ispom.types import Camera, Rig

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "calibration"
RADTAN = Camera(752, 480, 458.654321987, 457.296, 367.215, 248.375, (-0.28340811, 0.07395907, 1.9359e-4, 1.76187114e-5))
FISHEYE = Camera(800, 600, 250.123456789, 251.0, 402.0, 297.0, (0.02, -0.004, 1.1e-7, -0.0003), "fisheye")
RATIONAL = Camera(752, 480, 458.6, 457.2, 367.2, 248.3, (0.9, 0.2, 0.0003, -0.0002, 0.02, 1.2, 0.45, 0.06))
PINHOLE = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
POSE = Pose.from_rotvec(np.array([0.01, -0.02, 0.03]), np.array([0.11, -0.002, 0.0007]))


def close(one: Camera, other: Camera) -> bool:
    """To 1e-9, trailing zeros of the distortion aside."""

    def vector(camera: Camera) -> np.ndarray:
        values = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
        return np.array((*values, *(0.0,) * 8)[:14])

    return one.lens == other.lens and bool(np.abs(vector(one) - vector(other)).max() < 1e-9)


@pytest.mark.parametrize("camera", [RADTAN, FISHEYE, PINHOLE])
def test_round_trip_of_kalibr_and_euroc(tmp_path: Path, camera: Camera) -> None:
    placed = [Placed("left", camera, Pose()), Placed("right", RADTAN, POSE), Placed("video", camera, POSE @ POSE)]
    path = tmp_path / "camchain.yaml"
    path.write_text(kalibr_text(placed))
    for each, found in zip(placed, read_kalibr(path), strict=True):
        assert close(each.camera, found.camera)
        assert np.abs(each.body_from_camera.matrix - found.body_from_camera.matrix).max() < 1e-9
    sensor = tmp_path / "sensor.yaml"
    sensor.write_text(euroc_sensor_text(placed[1], 20.0))
    found = read_euroc_sensor(sensor)
    assert close(placed[1].camera, found.camera)
    assert np.abs(POSE.matrix - found.body_from_camera.matrix).max() < 1e-9


@pytest.mark.parametrize("camera", [RADTAN, FISHEYE, RATIONAL, PINHOLE])
def test_round_trip_of_opencv_ros_colmap_and_ours(tmp_path: Path, camera: Camera) -> None:
    path = tmp_path / "file.yaml"
    placed = [Placed("left", camera, Pose()), Placed("right", camera, POSE), Placed("video", PINHOLE, POSE @ POSE)]
    path.write_text(opencv_text(placed))
    for each, found in zip(placed, read_opencv(path), strict=True):
        assert each.name == found.name
        assert close(each.camera, found.camera)
        assert np.abs(each.body_from_camera.matrix - found.body_from_camera.matrix).max() < 1e-9
    path.write_text(opencv_text(placed[:1]))
    assert close(camera, read_opencv(path)[0].camera)
    path.write_text(ros_text(placed[0]))
    assert close(camera, read_opencv(path)[0].camera)
    path.write_text(colmap_cameras_text(placed))
    assert all(close(each.camera, found) for each, found in zip(placed, read_colmap_cameras(path), strict=True))
    path.write_text(camera_text(camera))
    assert close(camera, one_camera(path)[0])
    path.write_text(rig_text(Rig.of(video=camera, rig_from_video=POSE)))
    assert close(camera, read_rig(path).camera("video"))


def test_opencv_itself_reads_what_is_written(tmp_path: Path) -> None:
    path = tmp_path / "calibration.yml"
    path.write_text(opencv_text([Placed("left", RATIONAL, Pose()), Placed("right", RADTAN, POSE)]))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert np.array_equal(storage.getNode("K1").mat(), RATIONAL.matrix)
    assert storage.getNode("D1").mat().ravel() == pytest.approx(RATIONAL.distortion, abs=1e-12)
    assert np.abs(storage.getNode("R").mat() - POSE.inverse().rotation).max() < 1e-12
    assert int(storage.getNode("image_width").real()) == 752


def test_what_opencv_itself_wrote_is_read(tmp_path: Path) -> None:
    path = tmp_path / "calibration.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 752)
    storage.write("image_height", 480)
    storage.write("camera_matrix", RADTAN.matrix)
    storage.write("distortion_coefficients", np.array([[*RADTAN.distortion, 0.0]]).T)
    storage.release()
    assert close(RADTAN, read_opencv(path)[0].camera)


def test_colmap_itself_reads_what_is_written(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    (tmp_path / "cameras.txt").write_text(colmap_cameras_text([Placed("left", FISHEYE, Pose())]))
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).write_text("")
    camera = pycolmap.Reconstruction(str(tmp_path)).cameras[1]
    rays = np.array([[0.2, -0.3], [0.0, 0.0], [0.9, 0.4]])
    seen = np.array([camera.img_from_cam(np.append(ray, 1.0)) for ray in rays]).reshape(-1, 2)
    assert seen - 0.5 == pytest.approx(FISHEYE.project(np.column_stack([rays, np.ones(3)])), abs=1e-6)


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/calibration is not there")
def test_files_of_euroc_and_opencvs_samples_are_read() -> None:
    left, right = (
        read_euroc_sensor(DATA / "aprilgrid_stereo" / "reference" / f"euroc_cam{n}_sensor.yaml") for n in (0, 1)
    )
    assert (left.camera.fx, left.camera.distortion[1]) == (458.654, 0.07395907)
    between = left.body_from_camera.inverse() @ right.body_from_camera
    assert np.linalg.norm(between.translation) == pytest.approx(0.11007, abs=1e-5)
    sample = read_opencv(DATA / "chessboard_stereo" / "left_intrinsics.yml")[0].camera
    assert sample.fx == pytest.approx(535.915733961632)
    pair = read_opencv(DATA / "chessboard_stereo" / "intrinsics.yml", size=lambda: (640, 480))
    assert [each.camera.fx for each in pair] == pytest.approx([534.80326845051309] * 2)


def test_a_lens_that_a_format_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match=r"Kalibr .*8 coefficients"):
        kalibr_text([Placed("left", RATIONAL, Pose())])
    with pytest.raises(InputError, match=r"EuRoC's sensor\.yaml has no lens"):
        euroc_sensor_text(Placed("left", RATIONAL, Pose()))


@pytest.mark.parametrize(
    ("reader", "text", "message"),
    [
        (read_kalibr, "a: 1\n", "holds no cam0"),
        (read_kalibr, "cam0: {camera_model: omni}\n", "no pinhole camera"),
        (read_euroc_sensor, "resolution: [752, 480]\nintrinsics: [1, 2, 3]\n", "intrinsics needs 4"),
        (read_opencv, "%YAML:1.0\n---\na: 1\n", "holds no camera_matrix"),
        (read_opencv, "camera_matrix: {data: [1]}\ndistortion_model: other\n", "distortion_model is other"),
        (read_colmap_cameras, "1 PINHOLE 640 480 500\n", "PINHOLE has 4 parameters"),
        (read_colmap_cameras, "# nothing\n", "holds no camera"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path: Path, reader: object, text: str, message: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        reader(path)  # type: ignore[operator]
