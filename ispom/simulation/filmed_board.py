"""A calibration target filmed by three cameras (`sim:calibration`): its images, the poses of the board, the session.

The ground truth is exact. Adding noise to the projected points gives corners without rendering.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from ispom.geometry import Pose, so3_exp
from ispom.settings import Range
from ispom.types import Camera, FrameName, Image, Rig

LEFT = Camera(752, 480, 458.6, 457.3, 367.2, 248.4, (-0.283, 0.074, 0.0002, 0.00002))
RIGHT = Camera(752, 480, 457.6, 456.1, 380.0, 255.2, (-0.284, 0.0745, -0.0001, -0.00004))
VIDEO = Camera(640, 480, 452.0, 455.0, 322.3, 237.1, (-0.22, 0.06, 0.0006, -0.0004))
BASELINE_M = 0.11
PAUSE_S = 0.8
"""Time from one pose of the board to the next, while it is filmed in motion."""
BLUR_SAMPLES = 7
CAMERAS: tuple[FrameName, ...] = ("video", "left", "right")
SUBSAMPLES = 3
"""Rays per pixel in each direction."""
WALL = 96.0
"""Grey level of what is behind the board, on the average."""


@dataclass(frozen=True, eq=False)
class Picture:
    """The print on the board."""

    grey: Image
    """(H, W) grey levels."""
    pixels_per_m: float
    margin_m: float
    """Pixel (j, i) is centred at ((j + 0.5) / pixels_per_m - margin_m, (i + 0.5) / pixels_per_m - margin_m)."""


@dataclass(frozen=True)
class Exposing:
    """Imperfections of a real image."""

    blur_px: float = 0.6
    """Standard deviation of the lens blur."""
    noise: float = 2.0
    """Grey levels, standard deviation."""
    contrast: float = 0.8
    """Contrast of black and white; 1 for 0 and 255."""
    seed: int = 0


def board_image(
    picture: Picture, camera: Camera, camera_from_board: tuple[Pose, ...] | Pose, exposing: Exposing = Exposing()
) -> Image:
    """Renders a grey image (H, W). Several poses, of equal duration, give motion blur.

    The board lies in z = 0 of its frame; nothing behind the camera is visible.
    """
    poses = (camera_from_board,) if isinstance(camera_from_board, Pose) else camera_from_board
    light = np.asarray(sum(_seen(picture, camera, pose) for pose in poses), np.float32) / np.float32(len(poses))
    if exposing.blur_px > 0:
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), exposing.blur_px), np.float32)
    light = 127.5 + exposing.contrast * (light - 127.5)
    noise = np.random.default_rng(exposing.seed).standard_normal(light.shape, np.float32)
    return np.clip(light + exposing.noise * noise + 0.5, 0, 255).astype(np.uint8)


def _seen(picture: Picture, camera: Camera, camera_from_board: Pose) -> NDArray[np.float32]:
    """Renders (H, W) without blur or noise."""
    rays = _rays(camera)
    rotation, translation = camera_from_board.rotation, camera_from_board.translation
    # Picture from board (x, y, 1), board from camera: one homography for all rays (x, y, 1).
    scale, shift = picture.pixels_per_m, picture.margin_m * picture.pixels_per_m - 0.5
    to_picture = np.array([[scale, 0, shift], [0, scale, shift], [0, 0, 1]])
    board_from_rays = np.linalg.inv(np.column_stack([rotation[:, :2], translation]))
    a, b, w = (cv2.transform(rays, row[None].astype(np.float32)) for row in to_picture @ board_from_rays)
    ahead = w > 0 if (np.linalg.inv(board_from_rays)[2, 2]) > 0 else w < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (np.where(ahead, side / w, -1e4).clip(-1e4, 1e5) for side in (a, b))
    wall = WALL + 20 * np.sin(9 * rays[..., 0] + 3) * np.sin(7 * rays[..., 1])
    seen = cv2.remap(picture.grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    height, width = picture.grey.shape
    on_board = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    fine = np.where(on_board, seen.astype(np.float32), wall)
    small = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> NDArray[np.float32]:
    """(s H, s W, 2) on the plane z = 1; between pixel centres by interpolation."""
    u, v = np.meshgrid(np.arange(-1.0, camera.width + 1), np.arange(-1.0, camera.height + 1))
    rays = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(*u.shape, 2)
    fine_u = (np.arange(SUBSAMPLES * camera.width) + 0.5) / SUBSAMPLES + 0.5
    fine_v = (np.arange(SUBSAMPLES * camera.height) + 0.5) / SUBSAMPLES + 0.5
    places = np.meshgrid(fine_u.astype(np.float32), fine_v.astype(np.float32))
    rays = rays.astype(np.float32)
    fine = [cv2.remap(rays[..., k], *places, cv2.INTER_LINEAR) for k in (0, 1)]
    return np.stack(fine, axis=-1).astype(np.float32)


def filming_rig() -> Rig:
    """Returns three cameras that are not rectified; the rig frame is that of the left camera."""
    right = Pose.from_rotvec(np.radians([0.6, -0.9, 0.4]), np.array([BASELINE_M, 0.0008, -0.0011]))
    video = Pose.from_rotvec(np.radians([1.2, -1.7, 0.9]), np.array([0.06, -0.045, 0.03]))
    return Rig.of(video=VIDEO, left=LEFT, right=RIGHT, rig_from_video=video, rig_from_left=Pose(), rig_from_right=right)


def board_poses(camera: Camera, size_m: tuple[float, float], count: int, seed: int, alike: bool = False) -> list[Pose]:
    """Returns camera_from_board of `count` good views: tilted to 45 degrees, near and far, over the whole image.

    With `alike`, all views are bad: hardly tilted or moved.
    """
    rng = np.random.default_rng([seed, 2])
    centre_in_board = np.array([size_m[0] / 2, size_m[1] / 2, 0])
    out = []
    for _ in range(count):
        tilt = np.radians(rng.uniform(-45, 45, 2)) if not alike else np.radians(rng.normal(0, 0.3, 2))
        turn = np.radians(rng.uniform(-25, 25)) if not alike else np.radians(rng.normal(0, 1))
        rotation = so3_exp(np.array([tilt[0], tilt[1], 0])) @ so3_exp(np.array([0, 0, turn]))
        share = rng.uniform(0.35, 0.75) if not alike else 0.5
        distance = camera.fx * max(size_m[0] / camera.width, size_m[1] / camera.height) / share
        room = (1 - share) / 2 if not alike else 0.02
        uv = np.array([camera.width, camera.height]) * (0.5 + rng.uniform(-room, room, 2))
        at = np.append((uv - (camera.cx, camera.cy)) / (camera.fx, camera.fy), 1.0) * distance
        out.append(Pose(rotation, at - rotation @ centre_in_board))
    return out


@dataclass(frozen=True, eq=False)
class Filming:
    """The rig moves smoothly before a board that hangs still."""

    rig: Rig
    left_from_board: tuple[Pose, ...]
    """One pose each PAUSE_S."""
    clock_offset_s: float
    """Time shown by the video camera's clock minus that of the pair, at the same moment."""

    @staticmethod
    def of(rig: Rig, size_m: tuple[float, float], duration_s: float, seed: int, clock_offset_s: float = 0.0) -> Filming:
        """Makes a session with a board of this size; the left camera sees all of it most of the time."""
        count = max(4, round(duration_s / PAUSE_S) + 1)
        return Filming(rig, tuple(board_poses(rig.camera("left"), size_m, count, seed)), clock_offset_s)

    @property
    def duration_s(self) -> float:
        return PAUSE_S * (len(self.left_from_board) - 1)

    def left_from_board_at(self, time_s: float) -> Pose:
        """Returns the pose at a time [s] of the pair's clock."""
        rotations, positions = self._splines
        return Pose(rotations(time_s).as_matrix(), positions(time_s))

    @cached_property
    def _splines(self) -> tuple[RotationSpline, CubicSpline]:
        times = PAUSE_S * np.arange(len(self.left_from_board))
        rotations = RotationSpline(times, Rotation.from_matrix([p.rotation for p in self.left_from_board]))
        return rotations, CubicSpline(times, [p.translation for p in self.left_from_board])

    def video_from_board_at(self, video_time_s: float) -> Pose:
        """Returns the pose at a time [s] of the video camera's clock."""
        video_from_left = self.rig.rig_from_video.inverse() @ self.rig.rig_from_left
        return video_from_left @ self.left_from_board_at(video_time_s - self.clock_offset_s)


@dataclass(frozen=True)
class How:
    """Settings of the session."""

    views: Annotated[int, Range(1, 200)] = 25
    """Frames of each camera, at the same times."""
    seed: Annotated[int, Range(0, 2**31)] = 0
    """Seed of the board's poses and the noise."""
    alike: bool = False
    """Makes bad views: the board is hardly tilted or moved."""
    blur_ms: Annotated[float, Range(0, 200)] = 0.0
    """Duration for which the shutter is open while the cameras move."""
    noise: Annotated[float, Range(0, 50)] = 2.0
    """Sensor noise [grey levels]."""


@dataclass(frozen=True, eq=False)
class FilmedBoard:
    """The images, each rendered on request; the same bytes each time."""

    rig: Rig
    """The ground truth; its frame is that of the left camera."""
    picture: Picture
    how: How
    path: Filming

    @staticmethod
    def of(picture: Picture, size_m: tuple[float, float], camera: FrameName, how: How) -> FilmedBoard:
        """Makes a session with a board of this size, placed for `camera`; the others may see less of it."""
        rig = filming_rig()
        poses = board_poses(rig.camera(camera), size_m, max(how.views, 4), how.seed, how.alike)
        left_from_camera = rig.rig_from_left.inverse() @ rig.rig_from(camera)
        return FilmedBoard(rig, picture, how, Filming(rig, tuple(left_from_camera @ pose for pose in poses), 0.0))

    def image(self, camera: FrameName, i: int) -> Image:
        """Renders frame i (H, W), grey."""
        camera_from_left = self.rig.rig_from(camera).inverse() @ self.rig.rig_from_left
        poses = tuple(camera_from_left @ pose for pose in self._left_from_board(i))
        noise_seed = self.how.seed * 1000 + 3 * i + CAMERAS.index(camera)
        return board_image(
            self.picture, self.rig.camera(camera), poses, Exposing(noise=self.how.noise, seed=noise_seed)
        )

    def _left_from_board(self, i: int) -> tuple[Pose, ...]:
        """Returns the poses while the shutter is open."""
        if not self.how.blur_ms:
            return (self.path.left_from_board[i],)
        offsets_s = 1e-3 * self.how.blur_ms * ((np.arange(BLUR_SAMPLES) + 0.5) / BLUR_SAMPLES - 0.5)
        times = (PAUSE_S * i + offsets_s).clip(0, self.path.duration_s)
        return tuple(self.path.left_from_board_at(float(t)) for t in times)
