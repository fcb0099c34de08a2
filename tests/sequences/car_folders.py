"""Tiny recordings in the layouts of data sets of cars, and of folders whose camera is published."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from ispom.types import Image
from tests.sequences.folders import HEIGHT, START_NS, STEP_NS, WIDTH, images

DRIVE = "2013_05_28_drive_0007_sync"
FIRST, SCALE = 3, 1.25
"""Number of KITTI-360's first image; GNSS scale of 4Seasons."""


def make_kitti_360(root: Path, frames: int = 6, right: bool = True, truth: bool = True) -> Path:
    """Writes the images FIRST and later; the camera moves along x by 1 m per number."""
    base = root / "KITTI-360"
    drive = base / "data_2d_raw" / DRIVE
    stamps = "".join(f"2013-05-28 08:46:{2 + n * 0.1:012.9f}\n" for n in range(FIRST + frames))
    lines = ["corner_dist: 0.06"]
    for k, shift in enumerate((8, 0) if right else (8,)):
        inside = drive / f"image_0{k}" / "data_rect"
        inside.mkdir(parents=True)
        for i, image in enumerate(images(frames, shift)):
            cv2.imwrite(str(inside / f"{FIRST + i:010d}.png"), image)
        (inside.parent / "timestamps.txt").write_text(stamps)
    for k in (0, 1):
        lines += [f"S_0{k}: 100 70", f"D_0{k}: -0.3 0.1 0 0 0", f"S_rect_0{k}: {WIDTH} {HEIGHT}"]
        lines += [f"P_rect_0{k}: 80 0 47.5 {-48 * k} 0 80 31.5 0 0 0 1 0"]
    (base / "calibration").mkdir()
    (base / "calibration" / "perspective.txt").write_text("\n".join(lines) + "\n")
    if truth:
        poses = base / "data_poses" / DRIVE
        poses.mkdir(parents=True)
        rows = [f"{n} 1 0 0 {n} 0 1 0 0 0 0 1 0 0 0 0 1" for n in range(1, FIRST + frames, 2)]
        (poses / "cam0_to_world.txt").write_text("\n".join(rows) + "\n")
    return drive


def make_four_seasons(root: Path, frames: int = 6, right: bool = True, truth: bool = True) -> Path:
    """Writes a recording whose camera moves along x by 1 m per image; every second one is a keyframe."""
    folder = root / "recording_2020-10-07_14-47-51"
    for name, shift in (("cam0", 8), ("cam1", 0)) if right else (("cam0", 8),):
        inside = folder / "undistorted_images" / name
        inside.mkdir(parents=True)
        for i, image in enumerate(images(frames, shift)):
            cv2.imwrite(str(inside / f"{START_NS + i * STEP_NS}.png"), image)
    times = [START_NS + i * STEP_NS for i in range(frames)]
    (folder / "times.txt").write_text("".join(f"{t} {t * 1e-9:.9f} 1.5\n" for t in times))
    calibration = root / "calibration"
    calibration.mkdir()
    for k in (0, 1):
        text = f"Pinhole 80.0 80.0 47.5 31.5 0.0 0.0 0.0 0.0\n{WIDTH} {HEIGHT}\ncrop\n{WIDTH} {HEIGHT}\n"
        (calibration / f"undistorted_calib_{k}.txt").write_text(text)
    (calibration / "undistorted_calib_stereo.txt").write_text("1 0 0 -0.3\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    if truth:
        head = "# frame_id, t_x, t_y, t_z, q_x, q_y, q_z, q_w, scale, fusion_quality, v3\n"
        rows = [f"{t},{i / SCALE},0.0,0.0,0,0,0,1,{SCALE},1.0,1\n" for i, t in enumerate(times) if i % 2 == 0]
        (folder / "GNSSPoses.txt").write_text(head + "".join(rows))
    return folder


def make_robotcar(root: Path, frames: int = 6, right: bool = True) -> Path:
    """Writes raw images whose straight ones are theirs moved by two pixels to the left and one up."""
    folder = root / "2014-05-19-13-20-57"
    models = root / "models"
    models.mkdir(parents=True)
    for side, shift in (("left", 8), ("right", 0)) if right else (("left", 8),):
        inside = folder / "stereo" / side
        inside.mkdir(parents=True)
        for i, image in enumerate(images(frames, shift)):
            cv2.imwrite(str(inside / f"{(START_NS + i * STEP_NS) // 1000}.png"), image)
        (models / f"stereo_wide_{side}.txt").write_text("80.0 80.0 47.5 31.5\n0 0 1 0\n1 0 0 0\n0 1 0 0\n0 0 0 1\n")
        rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(float)
        (models / f"stereo_wide_{side}_distortion_lut.bin").write_bytes(np.stack([columns + 2, rows + 1]).tobytes())
    (folder / "stereo.timestamps").write_text("".join(f"{(START_NS + i * STEP_NS) // 1000} 1\n" for i in range(frames)))
    return folder


def make_icl_nuim(root: Path, frames: int = 6, size: tuple[int, int] = (640, 480)) -> Path:
    """Writes images without a calibration, and a list as ICL-NUIM has it."""
    folder = root / "living_room_traj0"
    (folder / "rgb").mkdir(parents=True)
    for i, image in enumerate(images(frames, 0)):
        large: Image = np.asarray(cv2.resize(image, size), np.uint8)
        cv2.imwrite(str(folder / "rgb" / f"{i}.png"), large)
    rows = [f"{i} depth/{i}.png {i} rgb/{i}.png\n" for i in range(frames)]
    (folder / "associations.txt").write_text("".join(rows))
    (folder / "livingRoom0.gt.freiburg").write_text("0 0 0 0 0 0 0 1\n")
    return folder


CARS: dict[str, Callable[[Path], Path]] = {
    "kitti-360": make_kitti_360,
    "kitti-360, one camera": lambda root: make_kitti_360(root, right=False, truth=False),
    "4seasons": make_four_seasons,
    "4seasons, one camera": lambda root: make_four_seasons(root, right=False, truth=False),
    "robotcar": make_robotcar,
    "robotcar, one camera": lambda root: make_robotcar(root, right=False),
    "icl-nuim": make_icl_nuim,
}
"""Each writes a recording of six exposures below a folder and gives its path."""
