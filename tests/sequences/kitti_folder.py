"""A tiny KITTI odometry drive on disk, for tests that then break it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT, BASELINE_M = 96, 64, 0.5


def make_drive(root: Path, frames: int = 6, right: bool = True, poses: bool = True, flat: bool = False) -> Path:
    """Writes `sequences/07` (and `poses/07.txt`) below root: noise that slides, or images without texture."""
    drive = root / "sequences" / "07"
    texture = np.random.default_rng(7).integers(0, 256, (HEIGHT, WIDTH + 4 * frames + 20), np.uint8)
    texture = np.full_like(texture, 128) if flat else cv2.GaussianBlur(texture, (0, 0), 1.5)
    for name, shift in (("image_0", 8), ("image_1", 0)) if right else (("image_0", 8),):
        (drive / name).mkdir(parents=True)
        for i in range(frames):
            cv2.imwrite(str(drive / name / f"{i:06d}.png"), texture[:, 4 * i + shift : 4 * i + shift + WIDTH])
    lines = [f"P{i}: 80 0 47.5 {-80 * BASELINE_M * i} 0 80 31.5 0 0 0 1 0" for i in range(2 if right else 1)]
    (drive / "calib.txt").write_text("\n".join(lines) + "\n")
    (drive / "times.txt").write_text("".join(f"{i / 10:e}\n" for i in range(frames)))
    if poses:
        (root / "poses").mkdir()
        rows = [f"1 0 0 {0.2 * i} 0 1 0 0 0 0 1 {0.5 * i}\n" for i in range(frames)]
        (root / "poses" / "07.txt").write_text("".join(rows))
    return drive
