"""Rendered tags: AprilTags on a wall and beside it, past which a camera moves; all true poses are known."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from ispom.geometry import Array, Pose, so3_exp
from ispom.types import Camera, Frame, Image, Rig, Sequence, Trajectory

CAMERA = Camera(320, 240, 260.0, 260.0, 159.5, 119.5)
SIDE_M, CELLS, CELL_PX = 0.16, 10, 12
"""Side of the black square, which has 8 cells; with its white border the print has 10."""
FINER = 4
"""Rendered pixels per pixel, along each side."""
WORLD_FROM_TAG = {
    0: Pose(np.eye(3), np.array([-0.22, -0.05, 1.0])),
    1: Pose(so3_exp(np.array([0.0, 0.0, 0.4])), np.array([0.03, -0.12, 1.0])),
    2: Pose(np.eye(3), np.array([0.05, 0.15, 1.0])),
    3: Pose(so3_exp(np.array([0.0, 0.5, 0.0])), np.array([0.33, 0.0, 0.93])),
    7: Pose(so3_exp(np.array([-0.4, 0.0, 0.0])), np.array([0.55, 0.1, 1.05])),
}


def world_from_camera(i: float) -> Pose:
    """Sideways in front of the wall, the view turning back to its middle, with some roll."""
    t = i / 30
    place = np.array([-0.3 + 0.75 * t, 0.08 * np.sin(5 * t), 0.12 * np.sin(3 * t)])
    return Pose(so3_exp(np.array([0.1 * np.sin(4 * t), 0.35 - 0.6 * t, 0.15 * np.sin(2 * t)])), place)


@cache
def printed(tag: int) -> Image:
    """The print of a tag with its white border."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    inner = cv2.aruco.generateImageMarker(dictionary, tag, (CELLS - 2) * CELL_PX)
    return np.asarray(
        cv2.copyMakeBorder(inner, CELL_PX, CELL_PX, CELL_PX, CELL_PX, cv2.BORDER_CONSTANT, value=(255,)), np.uint8
    )


def rendered(pose: Pose, camera: Camera = CAMERA, noise_seed: int | None = None) -> Image:
    """The image (H, W) of a camera at world_from_camera, without distortion."""
    size = (camera.width * FINER, camera.height * FINER)
    fine = np.full(size[::-1], 110, np.uint8)
    to_fine = np.array([[FINER, 0, (FINER - 1) / 2], [0, FINER, (FINER - 1) / 2], [0, 0, 1.0]]) @ camera.matrix
    side = CELLS * CELL_PX
    metres = SIDE_M / ((CELLS - 2) * CELL_PX)
    to_tag = np.array([[metres, 0, (0.5 - side / 2) * metres], [0, metres, (0.5 - side / 2) * metres], [0, 0, 1.0]])
    for tag, world_from_tag in WORLD_FROM_TAG.items():
        camera_from_tag = pose.inverse() @ world_from_tag
        columns = np.column_stack([camera_from_tag.rotation[:, :2], camera_from_tag.translation])
        if camera_from_tag.translation[2] < 0.2:
            continue
        homography = to_fine @ columns @ to_tag
        mask = cv2.warpPerspective(np.full((side, side), 255, np.uint8), homography, size, flags=cv2.INTER_NEAREST)
        ink = cv2.warpPerspective(printed(tag), homography, size, flags=cv2.INTER_LINEAR, borderValue=255)
        fine = np.where(mask > 0, ink, fine)
    image = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA).astype(float)
    image = 127.5 + 0.7 * (image - 127.5)
    if noise_seed is not None:
        image += np.random.default_rng(noise_seed).normal(0, 1.5, image.shape)
    return np.clip(image + 0.5, 0, 255).astype(np.uint8)


def tag_sequence(frames: int = 40) -> Sequence:
    """Video at 30 Hz with its ground truth."""
    times_ns = 33_000_000 * np.arange(frames, dtype=np.int64)
    truth = Trajectory.of([(int(t), world_from_camera(i)) for i, t in enumerate(times_ns)])
    images = [rendered(world_from_camera(i), noise_seed=i) for i in range(frames)]
    return Sequence(
        "tags",
        Rig.single(CAMERA),
        times_ns,
        ("video",) * frames,
        lambda i: Frame.video(int(times_ns[i]), images[i]),
        truth,
    )


def corners_in_world(tag: int) -> Array:
    """(4, 3) [m], clockwise from the top left."""
    half = SIDE_M / 2
    return WORLD_FROM_TAG[tag].apply(np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]))
