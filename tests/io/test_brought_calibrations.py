"""Calibration files as people bring them: read right by every way in, or refused in one sentence that is true."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.files import camera_text, left_out, rig_files
from ispom.io.calibrations.opencv import opencv_text
from ispom.io.calibrations.placed import Placed
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.io.rig import rig_text
from ispom.sequences import open_sequence
from ispom.types import Camera, Rig
from tests.sequences.folders import HEIGHT, WIDTH, images

REPORTS = Path(__file__).parents[2].parent / "shared" / "data" / "reports"
SIZE = (640, 480)
PINHOLE = Camera(*SIZE, 520.1, 521.3, 318.2, 241.7)
RADTAN = replace(PINHOLE, distortion=(-0.21, 0.06, 0.0006, -0.0004))
FIVE = replace(PINHOLE, distortion=(-0.21, 0.06, 0.0006, -0.0004, 0.013))
RATIONAL = replace(PINHOLE, distortion=(0.9, 0.2, 0.0003, -0.0002, 0.02, 1.2, 0.45, 0.06))
FISHEYE = replace(PINHOLE, distortion=(-0.011, 0.023, -0.017, 0.004), lens="fisheye")
LENSES = {"pinhole": PINHOLE, "radtan": RADTAN, "five": FIVE, "rational": RATIONAL, "fisheye": FISHEYE}
LEFT_FROM_RIGHT = Pose.from_rotvec(np.array([0.004, -0.012, 0.007]), np.array([0.1199, -0.0011, 0.0004]))
FORMATS = ("rig", "camera", "kalibr", "euroc", "opencv", "ros", "colmap")
K = "[520.1, 0, 318.2, 0, 521.3, 241.7, 0, 0, 1]"
ROS = f"image_width: 640\nimage_height: 480\ncamera_matrix: {{rows: 3, cols: 3, data: {K}}}\n"
COEFFICIENTS = "distortion_coefficients: {rows: 1, cols: 4, data: [-0.1, 0.05, 0.001, 0.0005]}\n"
PAIR = f"image_width: 640\nimage_height: 480\nM1: {{data: {K}}}\nD1: {{data: [-0.1, 0.05, 0, 0, 0]}}\n" + (
    f"M2: {{data: {K}}}\nD2: {{data: [-0.1, 0.05, 0, 0, 0]}}\n"
)


def written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def alike(one: Camera, other: Camera) -> bool:
    """To 1e-9, whatever zeros stand at the end of the distortion."""
    values = [np.array((*c.distortion, *(0.0,) * 8)[:8]) for c in (one, other)]
    same = (one.width, one.height, one.lens) == (other.width, other.height, other.lens)
    return same and np.abs(one.matrix - other.matrix).max() < 1e-9 and np.abs(values[0] - values[1]).max() < 1e-9


def storage(path: Path, **values: Any) -> Path:
    """As OpenCV writes it itself, in the format of the path's suffix."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        file.write(name, value)
    file.release()
    return path


@pytest.mark.parametrize(("lens", "form"), list(itertools.product(LENSES, FORMATS)))
def test_what_is_written_of_one_camera_is_read_back(lens: str, form: str, tmp_path: Path) -> None:
    camera, rig = LENSES[lens], Rig.single(LENSES[lens])
    try:
        files = {"rig.yaml": rig_text(rig)} if form == "rig" else rig_files(rig, form)  # type: ignore[arg-type]
    except InputError as fault:  # a lens that the format does not have
        assert lens in ("five", "rational") and form in ("kalibr", "euroc") and "has no lens" in str(fault)
        return
    ((name, text),) = files.items()
    assert alike(one_camera(written(tmp_path / name, text))[0], camera)
    assert alike(one_rig((tmp_path / name,))[0].camera("video"), camera)


@pytest.mark.parametrize(("lens", "form"), list(itertools.product(LENSES, FORMATS[2:])))
def test_what_is_written_of_a_pair_is_read_back(lens: str, form: str, tmp_path: Path) -> None:
    """Or it is said, before it is lost, that the format has no poses."""
    left, right = LENSES[lens], replace(LENSES[lens], fx=517.3, cx=322.9)
    rig = Rig.of(left=left, right=right, rig_from_right=LEFT_FROM_RIGHT)
    try:
        files = rig_files(rig, form)  # type: ignore[arg-type]
    except InputError as fault:
        assert lens in ("five", "rational") and form in ("kalibr", "euroc") and "has no lens" in str(fault)
        return
    for name, text in files.items():
        written(tmp_path / name, text)
    if form == "colmap":
        assert any("left and right" in note for note in left_out(rig, form))
        with pytest.raises(InputError, match="2 cameras"):
            one_rig((tmp_path / "cameras.txt",))[0]
        return
    assert not list(left_out(rig, form))  # type: ignore[arg-type]
    found = one_rig((tmp_path,))[0]
    assert alike(found.camera("left"), left) and alike(found.camera("right"), right)
    between = found.rig_from_left.inverse() @ found.rig_from_right
    np.testing.assert_allclose(between.matrix, LEFT_FROM_RIGHT.matrix, atol=1e-9)


def test_a_rig_of_three_as_ros_says_what_is_lost(tmp_path: Path) -> None:
    rig = Rig.of(video=PINHOLE, left=RADTAN, right=RADTAN, rig_from_right=LEFT_FROM_RIGHT)
    assert any("video" in note for note in left_out(rig, "ros"))
    for name, text in rig_files(rig, "ros").items():
        written(tmp_path / name, text)
    found = one_rig((tmp_path / "left.yaml", tmp_path / "right.yaml"))[0]
    assert found.baseline_m == pytest.approx(LEFT_FROM_RIGHT.translation[0])


def test_a_pair_of_ros_that_no_two_lenses_make_is_refused() -> None:
    with pytest.raises(InputError, match="fisheye"):
        rig_files(Rig.of(left=FISHEYE, right=RADTAN, rig_from_right=LEFT_FROM_RIGHT), "ros")


@pytest.mark.parametrize("suffix", ["yml", "yaml", "xml", "json"])
@pytest.mark.parametrize("lens", ["radtan", "fisheye"])
def test_files_that_opencv_writes_are_read(suffix: str, lens: str, tmp_path: Path) -> None:
    camera = LENSES[lens]
    path = storage(
        tmp_path / f"camera.{suffix}", image_width=640, image_height=480, fisheye_model=int(lens == "fisheye"),
        camera_matrix=camera.matrix, distortion_coefficients=np.array(camera.distortion)[:, None],
    )  # fmt: skip
    assert alike(one_camera(path)[0], camera)


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_pairs_that_opencv_writes_are_read(suffix: str, tmp_path: Path) -> None:
    right_from_left = LEFT_FROM_RIGHT.inverse()
    distortion = np.array([RADTAN.distortion])
    path = storage(
        tmp_path / f"stereo.{suffix}", image_width=640, image_height=480, cameraMatrix1=PINHOLE.matrix,
        distCoeffs1=distortion, cameraMatrix2=PINHOLE.matrix, distCoeffs2=distortion,
        R=right_from_left.rotation, T=right_from_left.translation[:, None],
    )  # fmt: skip
    rig = one_rig((path,))[0]
    assert alike(rig.camera("right"), RADTAN)
    np.testing.assert_allclose(rig.rig_from_right.matrix, LEFT_FROM_RIGHT.matrix, atol=1e-12)


@pytest.mark.parametrize("name", ["camera.yaml", "camera.yml", "film.yaml", "other.yml"])
def test_opencvs_file_is_read_next_to_images_and_films_and_as_camera(name: str, tmp_path: Path) -> None:
    """One reader for all ways in (row 1)."""
    small = Camera(WIDTH, HEIGHT, 80.0, 81.0, 47.5, 31.5, (-0.05, 0.01, 0.0, 0.0))
    path = written(tmp_path / "shot" / name, opencv_text([Placed("video", small, Pose())]))
    calibration = path if name == "other.yml" else None
    if name == "film.yaml":
        source = tmp_path / "shot" / "film.avi"
        film = cv2.VideoWriter(str(source), cv2.VideoWriter.fourcc(*"MJPG"), 20, (WIDTH, HEIGHT))
        for image in images(6, 8):
            film.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        film.release()
    else:
        source = tmp_path / "shot"
        for i, image in enumerate(images(6, 8)):
            cv2.imwrite(str(source / f"{i:03d}.png"), image)
    assert open_sequence(str(source), camera=calibration).rig.camera("video") == small


@pytest.mark.parametrize(
    "entry",
    ["fisheye_model: 1", "fisheye_model: true", "distortion_model: equidistant", "distortion_model: fisheye",
     "camera_model: kannala_brandt", "distortion_model: KannalaBrandt8"],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["tagged", "plain", "camera.yaml"])
def test_a_fisheye_is_one_whatever_says_so(entry: str, kind: str, tmp_path: Path) -> None:
    """Row 2."""
    text = ROS + COEFFICIENTS
    if kind == "tagged":
        text = "%YAML:1.0\n---\n" + text.replace("{rows", "!!opencv-matrix {rows")
    elif kind == "camera.yaml":
        text = "width: 640\nheight: 480\nfx: 520\nfy: 520\ncx: 320\ncy: 240\ndistortion: [-0.01, 0.02, -0.01, 0.004]\n"
    camera, _, notes = one_camera(written(tmp_path / "c.yaml", f"{text}{entry}\n"))
    assert camera.lens == "fisheye" and len(camera.distortion) == 4 and not notes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ROS + COEFFICIENTS + "fisheye_model: 1\ndistortion_model: plumb_bob\n", "plumb_bob but fisheye_model is 1"),
        (ROS + COEFFICIENTS + "distortion_model: fov\n", "distortion_model is fov, which is no pinhole"),
        (
            ROS.replace(K, "[520, 0, 0, 0, 521, 0, 318, 241, 1]") + COEFFICIENTS,
            "318 241 1, not 0 0 1: it is tra",
        ),
        (ROS.replace(K, "[520, 0, 318, 0, 521, 241, 0, 0, 2]") + COEFFICIENTS, "0 0 2, not 0 0 1: correct"),
        (ROS.replace(K, "[520, 318, 0, 0, 521, 241, 0, 0, 1]") + COEFFICIENTS, "has 318 and 0 next to its focal"),
        (ROS.replace("520.1", "-520.1") + COEFFICIENTS, r"fx is -520\.1, not positive"),
        (ROS + COEFFICIENTS.replace("0.0005]", "0.0005, 0, 0.3]"), "has 6 coefficients"),
        (ROS + COEFFICIENTS.replace("0.0005]", "0.0005, 0, 0, 0, 0, 0.1, 0, 0, 0]"), "thin prism"),
        (ROS.replace("image_width: 640\n", "") + COEFFICIENTS, "image_width and image_height"),
        (PAIR, r"2 cameras without their poses \(right\)"),
        (PAIR + "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [0, 0, 0]\n", "at one place"),
        (PAIR + "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [0.11, 0, 0]\n", "the cameras are exchanged"),
        (PAIR + "R: [1, 0, 0, 0, 0.9, 0, 0, 0, 1]\nT: [-0.11, 0, 0]\n", "R is no rotation"),
        ("R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.11, 0, 0]\n", "has the places of cameras only"),
        ("cam0: {T_imu_cam: 1, camera_model: omni}\n", "camera_model is omni"),
        ("Camera.type: PinHole\nCamera.fy: 500\n", "is no calibration that is known"),
    ],
)
def test_what_is_impossible_is_refused_in_one_true_sentence(text: str, message: str, tmp_path: Path) -> None:
    """Rows 3, 11, 23 and 24."""
    with pytest.raises(InputError, match=message) as caught:
        one_rig((written(tmp_path / "c.yaml", text),))[0]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("tail", [[0.0], [0.0, 0.0], [0.0] * 4, [0.0] * 10])
def test_zeros_at_the_end_of_the_distortion_are_none(tail: list[float], tmp_path: Path) -> None:
    """Row 25: in OpenCV's and ROS's files, Kalibr's, EuRoC's and ours."""
    values = list(RADTAN.distortion) + tail
    text = ROS + f"distortion_coefficients: {{data: {values}}}\ndistortion_model: rational_polynomial\n"
    assert alike(one_camera(written(tmp_path / "ros.yaml", text))[0], RADTAN)
    assert alike(one_camera(written(tmp_path / "k.yaml", kalibr(f"distortion_coeffs: {values}")))[0], RADTAN)
    own = camera_text(RADTAN).replace(str(list(RADTAN.distortion)), str(values))
    assert str(values) in own and alike(one_camera(written(tmp_path / "own.yaml", own))[0], RADTAN)


def test_all_fourteen_coefficients_of_a_rational_lens_are_read(tmp_path: Path) -> None:
    text = ROS + f"distortion_coefficients: {{data: {[*RATIONAL.distortion, *(0.0,) * 6]}}}\n"
    assert alike(one_camera(written(tmp_path / "ros.yaml", text))[0], RATIONAL)


def kalibr(
    distortion: str = "distortion_coeffs: [-0.21, 0.06, 0.0006, -0.0004]", poses: tuple[str, ...] = ("",)
) -> str:
    return "".join(
        f"cam{n}:\n  resolution: [640, 480]\n  intrinsics: [520.1, 521.3, 318.2, 241.7]\n  camera_model: pinhole\n"
        f"  distortion_model: radtan\n  {distortion}\n{pose}"
        for n, pose in enumerate(poses)
    )


def imu_poses(key: str, *cameras: Pose) -> tuple[str, ...]:
    """Of cameras whose pose is imu_from_camera."""
    poses = (pose if key == "T_imu_cam" else pose.inverse() for pose in cameras)
    return tuple(f"  {key}: {pose.matrix.tolist()}\n" for pose in poses)


@pytest.mark.parametrize("key", ["T_cam_imu", "T_imu_cam"])
def test_cameras_that_are_placed_at_the_imu(key: str, tmp_path: Path) -> None:
    """Row 19."""
    first = Pose.from_rotvec(np.array([1.2, -1.1, 1.3]), np.array([-0.02, -0.06, 0.01]))
    poses = imu_poses(key, first, first @ LEFT_FROM_RIGHT)
    rig, notes = one_rig((written(tmp_path / "chain.yaml", kalibr(poses=poses)),))
    between = rig.rig_from_left.inverse() @ rig.rig_from_right
    np.testing.assert_allclose(between.matrix, LEFT_FROM_RIGHT.matrix, atol=1e-9)
    assert not notes


def test_a_place_at_the_imu_that_is_inverted_is_mentioned(tmp_path: Path) -> None:
    first = Pose.from_rotvec(np.array([0, 0, np.pi / 2]), np.array([-0.02, -0.06, 0.01]))
    poses = imu_poses("T_imu_cam", first, first @ Pose(translation=np.array([0.11, 0, 0])))
    path = written(tmp_path / "chain.yaml", kalibr(poses=poses).replace("T_imu_cam", "T_cam_imu"))
    assert any("T_imu_cam" in note for note in one_rig((path,))[1])


def test_a_chain_that_places_one_camera_twice_says_so(tmp_path: Path) -> None:
    first = Pose.from_rotvec(np.array([1.2, -1.1, 1.3]), np.array([-0.02, -0.06, 0.01]))
    poses = imu_poses("T_imu_cam", first, first @ LEFT_FROM_RIGHT)
    other = f"  T_cn_cnm1: {Pose(translation=np.array([-0.3, 0, 0])).matrix.tolist()}\n"
    rig, notes = one_rig((written(tmp_path / "chain.yaml", kalibr(poses=(poses[0], poses[1] + other))),))
    assert any("cam1" in note and "T_cn_cnm1" in note for note in notes)
    assert (rig.rig_from_left.inverse() @ rig.rig_from_right).translation[0] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("baseline", "unit"),
    [(119.87, r"millimetres \(0\.1199 m\)"), (400.0, "millimetres"), (11.987, r"centimetres \(0\.12 m\)"),
     (4.8, "squares of the board"), (0.00012, "not in metres"), (0.12, None), (0.54, None)],
)  # fmt: skip
@pytest.mark.parametrize("form", ["opencv", "kalibr", "ros", "euroc"])
def test_a_baseline_that_is_not_in_metres_is_named_with_its_unit(
    baseline: float, unit: str | None, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Row 6."""
    rig = Rig.of(left=RADTAN, right=RADTAN, rig_from_right=Pose(translation=np.array([baseline, 0, 0])))
    for name, text in rig_files(rig, form).items():  # type: ignore[arg-type]
        written(tmp_path / "in" / name, text)
    assert main(["calibrate", "convert", str(tmp_path / "in"), "--out", str(tmp_path / "rig.yaml")]) == 0
    message = capsys.readouterr().err
    assert (unit is None) == (not message)
    if unit is not None:
        assert pytest.approx(baseline) == one_rig((tmp_path / "rig.yaml",))[0].baseline_m
        assert message.count("baseline is") == 1
        assert re.search(unit, message)


def test_intrinsics_and_extrinsics_of_opencv_are_given_together(tmp_path: Path) -> None:
    """Row 11: in either order, as a folder, and in sequence.yaml, where the images say how large they are."""
    lenses = written(tmp_path / "c" / "intrinsics.yml", "%YAML:1.0\n---\n" + PAIR)
    right_from_left = LEFT_FROM_RIGHT.inverse()
    places = storage(
        tmp_path / "c" / "extrinsics.yml", R=right_from_left.rotation, T=right_from_left.translation[:, None],
        R1=np.eye(3), Q=np.eye(4),
    )  # fmt: skip
    for given in ((lenses, places), (places, lenses), (tmp_path / "c",)):
        rig = one_rig(given)[0]
        np.testing.assert_allclose(rig.rig_from_right.matrix, LEFT_FROM_RIGHT.matrix, atol=1e-12)
    sizeless = PAIR.partition("M1")[2].replace("520.1, 0, 318.2", "80, 0, 47.5").replace("521.3, 241.7", "80, 31.5")
    lenses.write_text("%YAML:1.0\n---\nM1" + sizeless)
    with pytest.raises(InputError, match="image_width and image_height"):
        one_rig((lenses, places))[0]
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for i, image in enumerate(images(6, 8)):
            cv2.imwrite(str(tmp_path / side / f"{i:03d}.png"), image)
    text = "rig: [c/intrinsics.yml, c/extrinsics.yml]\nleft: left\nright: right\n"
    sequence = open_sequence(str(written(tmp_path / "sequence.yaml", text)))
    assert sequence.rig.baseline_m == pytest.approx(np.linalg.norm(LEFT_FROM_RIGHT.translation))
    assert any(f"{WIDTH} x {HEIGHT}" in note for note in sequence.notes)


@pytest.mark.parametrize("digits", [3, 4, 5, 8])
@pytest.mark.parametrize("form", ["opencv", "kalibr", "euroc"])
def test_a_rounded_rotation_is_made_orthonormal_in_every_format(digits: int, form: str, tmp_path: Path) -> None:
    """Row 24: one tolerance."""
    turn = np.round(Pose.from_rotvec(np.array([0.3, -0.2, 0.1]), np.zeros(3)).rotation, digits)
    rig = Rig.of(left=RADTAN, right=RADTAN, rig_from_right=Pose(turn, np.array([0.12, 0, 0])))
    for name, text in rig_files(rig, form).items():  # type: ignore[arg-type]
        written(tmp_path / name, text)
    found = one_rig((tmp_path,))[0].rig_from_right.rotation
    assert np.abs(found @ found.T - np.eye(3)).max() < 1e-12 and np.abs(found - turn).max() < 2 * 10.0**-digits
    wrong = rig.changed(rig_from_right=Pose(turn * 1.01, np.array([0.12, 0, 0])))
    for name, text in rig_files(wrong, form).items():  # type: ignore[arg-type]
        written(tmp_path / name, text)
    with pytest.raises(InputError, match="is no rotation"):
        one_rig((tmp_path,))[0]


def test_a_skew_and_an_odd_principal_point_are_mentioned(tmp_path: Path) -> None:
    """Row 3."""
    skewed = ROS.replace("[520.1, 0,", "[520.1, 0.31,") + COEFFICIENTS
    assert "0.31 px" in one_camera(written(tmp_path / "c.yaml", skewed))[2][0]
    odd = ROS.replace("318.2", "0").replace("241.7", "0") + COEFFICIENTS
    assert [note for note in one_camera(written(tmp_path / "c.yaml", odd))[2] if "cx is 0 px" in note]


def test_ros_messages_and_binning(tmp_path: Path) -> None:
    """Of `rostopic echo`: K is of the whole sensor, images are binned (row 29)."""
    text = f"width: 640\nheight: 480\ndistortion_model: plumb_bob\nD: [-0.1, 0.05, 0, 0, 0]\nK: {K}\n"
    text += "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nP: [520, 0, 320, -62.4, 0, 520, 240, 0, 0, 0, 1, 0]\n"
    assert one_camera(written(tmp_path / "c.yaml", text + "binning_x: 0\nbinning_y: 0\n"))[0].fx == 520.1
    binned, _, notes = one_camera(written(tmp_path / "c.yaml", text + "binning_x: 2\nbinning_y: 2\n"))
    assert (binned.width, binned.height, binned.fx, binned.cx) == (320, 240, 260.05, 159.1)
    assert "binning 2 x 2" in notes[0]
    part = "roi: {x_offset: 100, y_offset: 40, width: 320, height: 240, do_rectify: false}\n"
    cropped = one_camera(written(tmp_path / "c.yaml", text + part))[0]
    assert (cropped.width, cropped.height, cropped.fx, cropped.cy) == (320, 240, 520.1, 201.7)


def test_a_bomb_of_aliases_or_entities_is_refused(tmp_path: Path) -> None:
    aliases = "a: &a [1,1,1,1,1,1,1,1,1]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b]\n"
    aliases += (
        "d: &d [*c,*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d,*d]\nK1: !!opencv-matrix {data: [*e,*e,*e,*e]}\n"
    )
    with pytest.raises(InputError, match="aliases written out"):
        one_rig((written(tmp_path / "c.yml", "%YAML:1.0\n---\n" + aliases),))[0]
    xml = '<?xml version="1.0"?>\n<!DOCTYPE x [<!ENTITY a "aaaa">]>\n<opencv_storage><K1>&a;</K1></opencv_storage>'
    with pytest.raises(InputError, match="XML"):
        one_rig((written(tmp_path / "c.xml", xml),))[0]


REPORTED = {
    "02_opencv_fisheye_flag/fish_model1.yaml": lambda rig: rig.video.lens == "fisheye",
    "02_opencv_fisheye_flag/opencv_fisheye_model.yml": lambda rig: rig.video.lens == "fisheye",
    "03_camera_matrix_transposed/ros_transposed_k.yaml": "it is transposed",
    "11_opencv_pair_without_R_T/opencv_stereo_intrinsics_only.yml": "2 cameras",
    "11_opencv_pair_without_R_T/opencv_sample_intrinsics.yml": "image_width and image_height",
    "19_kalibr_imu_poses_only/kalibr_T_cam_imu_only.yaml": lambda rig: (
        np.linalg.norm(rig.rig_from_right.translation - rig.rig_from_left.translation) == pytest.approx(0.11)
    ),
    "23_negative_baseline/kalibr_cam1_left.yaml": "the cameras are exchanged",
    "24_rounded_rotation/opencv_stereo_r5digits.yml": lambda rig: 0.119 < rig.baseline_m < 0.121,
    "25_more_coefficients/ros_rational14.yaml": lambda rig: rig.video.distortion[5] == 0.6,
}


@pytest.mark.skipif(not REPORTS.is_dir(), reason="../shared/data/reports is not there")
@pytest.mark.parametrize("name", REPORTED)
def test_the_files_that_were_reported(name: str) -> None:
    expected = REPORTED[name]
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            one_rig((REPORTS / name,))[0]
    else:
        assert expected(one_rig((REPORTS / name,))[0])


@pytest.mark.skipif(not REPORTS.is_dir(), reason="../shared/data/reports is not there")
def test_the_pair_of_ros_that_was_reported() -> None:
    pair = REPORTS / "17_ros_pair"
    for files in (("ros_left.yaml", "ros_right.yaml"), ("ros_right.yaml", "ros_left.yaml")):
        assert one_rig(tuple(pair / file for file in files))[0].baseline_m == pytest.approx(0.12)
    with pytest.raises(InputError, match="at one place"):
        one_rig((pair / "ros_own",))[0]


def test_json_of_opencv_by_hand(tmp_path: Path) -> None:
    content = {"image_size": [640, 480], "mtx": PINHOLE.matrix.tolist(), "dist": [list(FIVE.distortion)]}
    assert alike(one_camera(written(tmp_path / "calibration.json", json.dumps(content)))[0], FIVE)


def test_single_coefficients_of_a_camera_file_are_its_distortion(tmp_path: Path) -> None:
    own = "{width: 640, height: 480, fx: 520, fy: 520, cx: 320, cy: 240, "
    assert one_camera(written(tmp_path / "c.yaml", own + "k1: -0.3, k2: 0.1}"))[0].distortion == (-0.3, 0.1, 0, 0)
    assert one_camera(written(tmp_path / "c.yaml", own + "k1: -0.3, k3: 0.1}"))[0].distortion == (-0.3, 0, 0, 0, 0.1)
    fisheye = own + "model: fisheye, k1: 0.01, k3: 0.001}"
    assert one_camera(written(tmp_path / "c.yaml", fisheye))[0].distortion == (0.01, 0, 0.001, 0)
    with pytest.raises(InputError, match="distortion and k1"):
        one_camera(written(tmp_path / "c.yaml", own + "k1: -0.3, distortion: [0, 0, 0, 0]}"))[0]
    assert "skew skipped" in one_camera(written(tmp_path / "c.yaml", own + "skew: 1.2}"))[2][0]


def test_quaternions_whose_first_number_is_w(tmp_path: Path) -> None:
    """Called so, they are read; else they are mentioned, where they turn a camera upside down."""
    rig = Rig.of(left=PINHOLE, right=PINHOLE, rig_from_right=Pose(translation=np.array([0.12, 0, 0])))
    text = rig_text(rig).replace("- 0.0\n    - 0.0\n    - 0.0\n    - 1.0", "- 1.0\n    - 0.0\n    - 0.0\n    - 0.0")
    assert text != rig_text(rig)
    wrong, notes = one_rig((written(tmp_path / "rig.yaml", text),))
    assert wrong.rig_from_left.rotation[1, 1] == -1 and sum("w?" in note for note in notes) == 2
    found, notes = one_rig((written(tmp_path / "rig.yaml", text.replace("rotation_xyzw", "rotation_wxyz")),))
    assert found.baseline_m == pytest.approx(0.12) and not notes
    np.testing.assert_array_equal(found.rig_from_left.rotation, np.eye(3))
