"""Tiny recordings on disk in the layouts of data sets, for tests that then break them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from ispom.io.kitti import EARTH_RADIUS_M
from ispom.types import Image
from tests.sequences.kitti_folder import make_drive

WIDTH, HEIGHT = 96, 64
START_NS, STEP_NS = 1_403_715_273_262_142_976, 50_000_000


def images(frames: int, shift: int) -> list[Image]:
    """Noise that slides."""
    texture = np.random.default_rng(7).integers(0, 256, (HEIGHT, WIDTH + 4 * frames + 20), np.uint8)
    texture = cv2.GaussianBlur(texture, (0, 0), 1.5)
    return [np.ascontiguousarray(texture[:, 4 * i + shift :][:, :WIDTH]) for i in range(frames)]


def make_euroc(root: Path, frames: int = 6, right: bool = True, truth: bool = True) -> Path:
    """Writes `V9/mav0`; the truth, of the body, has three poses per image."""
    mav0 = root / "V9" / "mav0"
    for camera, shift, y in (("cam0", 8, -0.06), ("cam1", 0, 0.05)) if right else (("cam0", 8, -0.06),):
        (mav0 / camera / "data").mkdir(parents=True)
        lines = ["#timestamp [ns],filename"]
        for i, image in enumerate(images(frames, shift)):
            lines.append(f"{START_NS + i * STEP_NS},{START_NS + i * STEP_NS}.png")
            cv2.imwrite(str(mav0 / camera / "data" / f"{START_NS + i * STEP_NS}.png"), image)
        (mav0 / camera / "data.csv").write_text("\r\n".join(lines) + "\r\n")
        # As on the real platform: the camera's x axis is the body's y axis.
        (mav0 / camera / "sensor.yaml").write_text(
            "%YAML:1.0\n# made for a test\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
            f"  data: [0, -1, 0, -0.02, 1, 0, 0, {y}, 0, 0, 1, 0.01, 0, 0, 0, 1]\n"
            f"rate_hz: 20\nresolution: [{WIDTH}, {HEIGHT}]\ncamera_model: pinhole\n"
            "intrinsics: [80.0, 80.0, 47.5, 31.5]\ndistortion_model: radial-tangential\n"
            "distortion_coefficients: [-0.05, 0.01, 0.0, 0.0]\n"
        )
    if truth:
        (mav0 / "state_groundtruth_estimate0").mkdir()
        rows = ["#timestamp, p_RS_R_x [m], ..."]
        times = range(START_NS - STEP_NS // 3, START_NS + frames * STEP_NS, STEP_NS // 3)
        rows += [f"{t},{(t - START_NS) * 1e-9:.9f},2,3,1,0,0,0" + ",0" * 9 for t in times]
        (mav0 / "state_groundtruth_estimate0" / "data.csv").write_text("\n".join(rows) + "\n")
    return mav0.parent


def make_tum(root: Path, frames: int = 6, truth: bool = True) -> Path:
    """Writes rgb.txt, camera.yaml and coloured JPEG images."""
    (root / "rgb").mkdir(parents=True)
    lines = ["# timestamp filename"]
    for i, image in enumerate(images(frames, 0)):
        lines.append(f"{i / 30:.6f} rgb/{i}.jpg")
        cv2.imwrite(str(root / "rgb" / f"{i}.jpg"), np.dstack([image, image, 255 - image]))
    (root / "rgb.txt").write_text("\n".join(lines) + "\n")
    (root / "camera.yaml").write_text(
        f"model: opencv\nwidth: {WIDTH}\nheight: {HEIGHT}\nfx: 80\nfy: 80\ncx: 47.5\ncy: 31.5\n"
        "distortion: [-0.05, 0.01, 0, 0]\n"
    )
    if truth:
        rows = [f"{i / 100:.6f} {i / 100} 0 0 0 0 0 1" for i in range(1, 4 * frames)]
        (root / "groundtruth.txt").write_text("\n".join(rows) + "\n")
    return root


def make_kitti_raw(root: Path, frames: int = 6, raw: bool = False, colour: bool = False, truth: bool = True) -> Path:
    """Writes a drive below its day's folder; `raw` images are larger than rectified ones and a little distorted.

    The truth is that of a car that drives east on the equator, 1 m per image; the unit sits 0.8 m below the laser.
    """
    drive = root / "2011_09_26" / f"2011_09_26_drive_0009_{'extract' if raw else 'sync'}"
    lines = ["calib_time: 09-Jan-2012 13:57:47"]
    for i, shift in enumerate((8, 0)):
        camera = f"{2 * colour + i:02d}"
        (drive / f"image_{camera}" / "data").mkdir(parents=True)
        for frame, image in enumerate(images(frames, shift)):
            path = drive / f"image_{camera}" / "data" / f"{frame:010d}.png"
            cv2.imwrite(str(path), np.pad(image, 4 * raw, mode="edge"))
        stamps = [f"2011-09-26 13:02:{25 + 0.1 * frame:012.9f}" for frame in range(frames)]
        (drive / f"image_{camera}" / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    for i, camera in enumerate(("00", "01", "02", "03")):
        lines += [f"S_{camera}: {WIDTH + 8} {HEIGHT + 8}", f"K_{camera}: 80 0 51.5 0 80 35.5 0 0 1"]
        lines += [f"D_{camera}: -0.05 0.01 0 0 0", f"R_rect_{camera}: 1 0 0 0 1 0 0 0 1"]
        tx = 2 - 40 * (i % 2)
        lines += [f"S_rect_{camera}: {WIDTH} {HEIGHT}", f"P_rect_{camera}: 80 0 47.5 {tx} 0 80 31.5 0 0 0 1 0"]
    (drive.parent / "calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n")
    if truth:
        (drive / "oxts" / "data").mkdir(parents=True)
        for frame in range(frames):
            degrees = np.degrees(frame / EARTH_RADIUS_M)
            sample = f"0 {8 + degrees:.14f} 100 0 0 0 {' 0' * 24}\n"  # looking east: no yaw
            (drive / "oxts" / "data" / f"{frame:010d}.txt").write_text(sample)
        stamps = [f"2011-09-26 13:02:{25 + 0.1 * frame:012.9f}" for frame in range(frames)]
        (drive / "oxts" / "timestamps.txt").write_text("\n".join(stamps) + "\n")
        head = "calib_time: 25-May-2012 16:47:16\n"
        # The laser's axes are those of the unit (x ahead, y left, z up); the camera looks ahead, its y axis down.
        (drive.parent / "calib_imu_to_velo.txt").write_text(f"{head}R: 1 0 0 0 1 0 0 0 1\nT: -0.5 0 -0.8\n")
        (drive.parent / "calib_velo_to_cam.txt").write_text(f"{head}R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.1 -0.3\n")
    return drive


def make_seven_scenes(root: Path, frames: int = 6, truth: bool = True) -> Path:
    """Writes seq-01 with camera.yaml beside it; the camera moves along x."""
    folder = root / "chess" / "seq-01"
    folder.mkdir(parents=True)
    for i, image in enumerate(images(frames, 0)):
        cv2.imwrite(str(folder / f"frame-{i:06d}.color.png"), np.dstack([image, image, 255 - image]))
        cv2.imwrite(str(folder / f"frame-{i:06d}.depth.png"), np.full(image.shape, 1000, np.uint16))
        if truth:
            pose = f"1 0 0 {i / 10:.7e}\t\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
            (folder / f"frame-{i:06d}.pose.txt").write_text(pose)
    (root / "chess" / "camera.yaml").write_text(
        f"{{width: {WIDTH}, height: {HEIGHT}, fx: 80, fy: 80, cx: 47.5, cy: 31.5}}"
    )
    return folder


def make_vslam_lab(root: Path, frames: int = 6, right: bool = True, truth: bool = True, distorted: bool = True) -> Path:
    """Writes `V9` as VSLAM-LAB does; the body moves along its x axis by 1 m/s, the right camera is 0.11 m beside the
    left one."""
    folder = root / "V9"
    cameras = (("rgb_0", 8, 0.0), ("rgb_1", 0, 0.11)) if right else (("rgb_0", 8, 0.0),)
    lines, rows = ["%YAML 1.2", "---", "cameras:"], [[str(START_NS + i * STEP_NS)] for i in range(frames)]
    for name, shift, x in cameras:
        (folder / name).mkdir(parents=True)
        for i, image in enumerate(images(frames, shift)):
            cv2.imwrite(str(folder / name / f"{i:05d}.png"), image)
        lens = [
            "     distortion_type: radtan4,",
            "     distortion_coefficients: [-0.05, 0.01, 0.0, 0.0], ",
        ]
        matrix = [1.0, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
        lines += [f"  - {{cam_name: {name},", "     cam_type: gray,", "     cam_model: pinhole,"]
        lines += [
            "     focal_length: [80.0, 80.0],",
            "     principal_point: [47.5, 31.5],",
            *(lens if distorted else []),
        ]
        lines += [f"     image_dimension: [{WIDTH}, {HEIGHT}],", "     fps: 20.0,"]
        lines += [f"     T_BS: [{', '.join(f'{v:.13f}' for v in matrix)}] # Sensor extrinsics wrt. the body-frame."]
        lines += ["    }", ""]
    (folder / "calibration.yaml").write_text("\n".join(lines))
    header = [word for name, *_ in cameras for word in (f"ts_{name} (ns)", f"path_{name}")]
    cells = [[cell for name, *_ in cameras for cell in (row[0], f"{name}/{i:05d}.png")] for i, row in enumerate(rows)]
    (folder / "rgb.csv").write_text("".join(f"{','.join(row)}\n" for row in [header, *cells]))
    poses = [f"{t},{(t - START_NS) * 1e-9:.9f},2,3,0,0,0,1" for (t,) in ([int(row[0])] for row in rows)]
    table = ["ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw", *(poses if truth else [])]  # without truth, the header alone
    (folder / "groundtruth.csv").write_text("\n".join(table) + "\n")
    return folder


def make_parking(root: Path, frames: int = 6, truth: bool = True) -> Path:
    """Writes `parking` as UZH's course has it; the camera moves along x."""
    folder = root / "parking"
    (folder / "images").mkdir(parents=True)
    for i, image in enumerate(images(frames, 0)):
        cv2.imwrite(str(folder / "images" / f"img_{i:05d}.png"), image)
    (folder / "K.txt").write_text("80.0, 0,        47.5,\n0,      78.0, 31.5,\n0,      0,      1,\n")
    if truth:
        (folder / "poses.txt").write_text("".join(f"1 0 0 {i / 10} 0 1 0 0 0 0 1 0 \n" for i in range(frames)))
    return folder


def make_malaga(root: Path, frames: int = 6, calibrated: bool = True) -> Path:
    """Writes an extract of the Malaga data set with images of the usual size, where there is no calibration."""
    folder = root / "malaga-urban-dataset-extract-07"
    size = (WIDTH, HEIGHT) if calibrated else (800, 600)
    inner = folder / f"{folder.name}_rectified_{size[0]}x{size[1]}_Images"
    inner.mkdir(parents=True)
    for i in range(frames):
        for side, shift in (("left", 8), ("right", 0)):
            image = cv2.resize(images(frames, shift)[i], size)
            cv2.imwrite(str(inner / f"img_CAMERA1_{1261229981 + i}.{580023 + i}_{side}.jpg"), image)
    if calibrated:
        text = "// made for a test\n" + "".join(
            f"[CAMERA_{side}]\nresolution=[{WIDTH} {HEIGHT}]\ncx={cx}\ncy=31.5\nfx=80.0 // [px]\nfy=80.0\n"
            "dist=[0 0 0 0 0]\n"
            for side, cx in (("LEFT", 49.5), ("RIGHT", 47.5))
        )
        pose = "pose_quaternion=[0.119320 -0.000336 0.000373 0.999994 -0.000329 -0.001567 0.003142]"
        path = folder / f"camera_params_rectified_a=0_{WIDTH}x{HEIGHT}.txt"
        path.write_text(f"{text}[CAMERA_LEFT2RIGHT_POSE]\n{pose}\n")
    return folder


MAKERS: dict[str, Callable[[Path], Path]] = {
    "kitti": make_drive,
    "kitti, one camera": lambda root: make_drive(root, right=False, poses=False),
    "euroc": make_euroc,
    "euroc, one camera": lambda root: make_euroc(root, right=False, truth=False),
    "vslam-lab": make_vslam_lab,
    "vslam-lab, rectified": lambda root: make_vslam_lab(root, distorted=False),
    "vslam-lab, one camera": lambda root: make_vslam_lab(root, right=False, truth=False),
    "parking": make_parking,
    "malaga": make_malaga,
    "tum": make_tum,
    "7-scenes": make_seven_scenes,
    "kitti raw, sync": make_kitti_raw,
    "kitti raw, extract": lambda root: make_kitti_raw(root, raw=True),
}
"""Each writes a recording of six exposures below a folder and gives its path."""
