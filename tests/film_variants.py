"""A film of a simulation as it can go wrong on its way to a person: what each variant is, exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ispom.sequences import open_sequence
from ispom.types import Camera, Frame, Image, Rig, Sequence, is_video

SOURCE, FRAMES, JUMP = "sim:tiny", 50, 28
"""The simulation, how many of its images the film has, and at which one the zoom jumps."""


@dataclass(frozen=True)
class Variant:
    """What is done to image k of a camera, and the camera that the file states."""

    image: Callable[[Callable[[int], Image], int, Camera], Image] = lambda images, k, camera: images(k)
    camera: Callable[[Camera], Camera] = lambda camera: camera


def _resized(width: float, height: float) -> Variant:
    """With fx and fy left as they were."""

    def image(images: Callable[[int], Image], k: int, camera: Camera) -> Image:
        size = round(width * camera.width), round(height * camera.height)
        return np.asarray(cv2.resize(images(k), size, interpolation=cv2.INTER_AREA), np.uint8)

    def stated(camera: Camera) -> Camera:
        cx, cy = (camera.cx + 0.5) * width - 0.5, (camera.cy + 0.5) * height - 0.5
        size = round(width * camera.width), round(height * camera.height)
        return replace(camera, width=size[0], height=size[1], cx=cx, cy=cy)

    return Variant(image, stated)


def _undistorted(images: Callable[[int], Image], k: int, camera: Camera) -> Image:
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    return np.asarray(cv2.undistort(images(k), matrix, np.array(camera.distortion)), np.uint8)


def _lettered(images: Callable[[int], Image], k: int, camera: Camera) -> Image:
    image, where = images(k).copy(), (camera.width // 20, camera.height - camera.height // 20)
    cv2.putText(image, f"CAM 1 12:00:{k:02d}", where, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 2)
    return image


def _title(images: Callable[[int], Image], k: int, camera: Camera) -> Image:
    image = np.full_like(images(0), 20)
    cv2.putText(image, "A film", (60, 120), cv2.FONT_HERSHEY_SIMPLEX, 2, (255, 255, 255), 4)
    return image if k < 12 else images(k - 12)


def _zoomed(images: Callable[[int], Image], k: int, camera: Camera) -> Image:
    """By 15 % at once."""
    times = 1.15 if k >= JUMP else 1.0
    matrix = np.array([[times, 0, (1 - times) * camera.cx], [0, times, (1 - times) * camera.cy]])
    return np.asarray(cv2.warpAffine(images(k), matrix, (camera.width, camera.height)), np.uint8)


VARIANTS: Mapping[str, Variant] = {
    "as it was": Variant(),
    "squeezed in height": _resized(1.0, 0.75),
    "squeezed in width": _resized(0.75, 1.0),
    "focal length too long": Variant(camera=lambda c: replace(c, fx=1.22 * c.fx, fy=1.22 * c.fy)),
    "distortion zeroed": Variant(camera=lambda c: replace(c, distortion=())),
    "undistorted twice": Variant(_undistorted),
    "mirrored": Variant(lambda images, k, camera: np.ascontiguousarray(images(k)[:, ::-1])),
    "cut": Variant(lambda images, k, camera: images(k if k < 25 else min(k + 30, 78))),
    "title": Variant(_title),
    "repeated": Variant(lambda images, k, camera: images(k - (k % 5 == 4))),
    "letters": Variant(_lettered),
    "zoom": Variant(_zoomed),
}


def film(name: str) -> Sequence:
    """The video camera alone, with its truth."""
    whole, variant = open_sequence(SOURCE), VARIANTS[name]
    video = [i for i, kind in enumerate(whole.kinds) if kind == "video"]
    camera, times_ns = whole.rig.camera("video"), whole.times_ns[video][:FRAMES]

    def images(k: int) -> Image:
        measured = whole.load(video[k])
        assert is_video(measured)
        return measured.image

    def load(k: int) -> Frame:
        return Frame.video(int(times_ns[k]), variant.image(images, k, camera))

    rig = Rig.single(variant.camera(camera))
    truth = whole.truth and whole.truth.moved(right=whole.rig.rig_from_video)
    return Sequence(f"film {name}", rig, times_ns, ("video",) * FRAMES, load, truth)
