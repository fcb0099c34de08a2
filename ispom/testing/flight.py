"""A short flight through a made-up cloud of balls, for which no file is needed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Camera, Frame, FrameName, Image, Measurement, Rig

BALLS, BALL_M = 700, 0.12
VIDEO_FRAMES, STEREO_EVERY = 40, 3
SPEED_M_PER_FRAME = 0.13


def flight(rig: Rig, all_at_once: bool = False) -> list[Measurement]:
    """Video and, a little later than every few of its frames, stereo: forward past balls at 2 to 20 m, in a bend.

    `all_at_once`: frames of all three cameras at the times of the stereo frames instead.
    """
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-8, -6, 2), (8, 6, 20 + SPEED_M_PER_FRAME * VIDEO_FRAMES), (BALLS, 3))
    grey, measurements = rng.integers(40, 255, BALLS), list[Measurement]()

    def seen(name: FrameName, frame: float) -> Image:
        world_from_rig = Pose.from_rotvec(
            np.array([0.0, 0.003 * frame, 0.0]), np.array([0.001 * frame**2, 0.0, SPEED_M_PER_FRAME * frame])
        )
        image = _image(rig.camera(name), (world_from_rig @ rig.rig_from(name)).inverse().apply(xyz), grey)
        return np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)

    for i in range(VIDEO_FRAMES):
        time_ns = i * 33_000_000
        if all_at_once and i % STEREO_EVERY == 0:
            measurements.append(Frame(time_ns + 11_000_000, {name: seen(name, i + 1 / 3) for name in rig.cameras}))
        if all_at_once:
            continue
        measurements.append(Frame.video(time_ns, seen("video", i)))
        if i % STEREO_EVERY == 0:
            measurements.append(Frame.stereo(time_ns + 11_000_000, seen("left", i + 1 / 3), seen("right", i + 1 / 3)))
    return measurements


def flight_rig(all_at_once: bool = False) -> Rig:
    """320 x 240 pixels: a pair of 0.3 m, and a video camera next to it whose lens distorts; with `all_at_once`, three
    cameras with other names."""
    pair = Rig.stereo(Camera(320, 240, 230.0, 230.0, 159.5, 119.5), 0.3)
    video = Camera(320, 240, 226.0, 227.0, 161.0, 118.5, (-0.05, 0.01, 0.0, 0.0))
    offset = Pose.from_rotvec(np.array([0.01, -0.02, 0.01]), np.array([0.02, -0.04, 0.03]))
    rig = pair.changed(video=video, rig_from_video=offset)
    return Rig({f"{name}_camera": sensor for name, sensor in rig.sensors.items()}) if all_at_once else rig


def _image(camera: Camera, xyz_in_camera: Array, grey: NDArray) -> Image:
    """(H, W): balls as discs, the near ones in front."""
    image = np.full((camera.height, camera.width), 20, np.uint8)
    ahead = (xyz_in_camera[:, 2] > 1) & (np.abs(xyz_in_camera[:, :2]) < xyz_in_camera[:, 2:]).all(axis=1)
    uv = camera.project(xyz_in_camera)
    for i in sorted(np.flatnonzero(ahead), key=lambda i: -xyz_in_camera[i, 2]):
        centre = (round(16 * uv[i, 0]), round(16 * uv[i, 1]))
        radius = round(16 * camera.fx * BALL_M / xyz_in_camera[i, 2])
        cv2.circle(image, centre, radius, int(grey[i]), -1, cv2.LINE_AA, 4)
    return image
