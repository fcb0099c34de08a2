"""Looks at a place: images with depth and pose, from the stereo pairs of a run or from its video."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, UnreadableImage
from ispom.geometry import Array, Pose
from ispom.reconstruction.depth import DenseStereo, Depth
from ispom.reconstruction.fusion import Fusion, FusionSettings
from ispom.reconstruction.model import Mesh, Points
from ispom.reconstruction.plane_sweep import PlaneSweep, Undistortion
from ispom.solvers.trajectory.continuous import Between, known_at, poses_at
from ispom.types import Camera, Image, Kind, Measurement, Sequence, Trajectory, is_stereo, is_video

from .options import From

VOXELS_PER_BASELINE = 10
VOXELS_IN_NEAR_DEPTH = 80
"""Where no pair gives a baseline: about a percent of the depth, by which a plane sweep is wrong on rendered images."""
MAX_DEPTH_BASELINES = 25.0
"""Where a disparity that is 0.25 px wrong puts a point 1 % of 25 baselines off, at a focal length of 600 px."""
NEAREST_BASELINES = 4.0
"""Least depth in the video, in baselines, as DenseStereo has it for pairs."""
EVERY_BASELINES = 1.0
"""Displacement from one image of the video that gets a depth to the next, in baselines."""
OTHERS_BASELINES = (1.0, 2.0)
"""Displacements from such an image to those with which it is compared, before and after it, in baselines."""
LEAST_BASELINES = 8.0
"""A path of fewer baselines than this is divided into as many: on a short one, nearer images are compared."""
MAX_PIXELS = 640 * 480
"""Larger images of the video are reduced to this: time and memory of the plane sweep grow with it, and voxels of an
eightieth of the depth are coarser than its pixels at focal lengths from 80 px on."""


@dataclass(frozen=True)
class DenseSettings:
    """How a surface is made."""

    baseline: float
    """Distance of the cameras of the pair, or what stands for it among the images of one camera; like voxel and depth
    in the unit of the poses: [m], or the method's own."""
    voxel: float
    max_depth: float
    memory_gb: float
    between: Between
    depth_from: From = "stereo"
    as_given: bool = False
    """Only images whose times have poses of the method, none interpolated."""


@dataclass(frozen=True, eq=False)
class Look:
    """What one camera without distortion saw."""

    image: Image
    depth: Depth
    camera: Camera
    world_from_camera: Pose


Making = Callable[[], Look | None]
"""Reads the images and finds the depth; None where there is no pose, or an image is unreadable."""


def looks(sequence: Sequence, path: Trajectory, settings: DenseSettings) -> list[Making]:
    """Of the cameras in the settings, with poses world_from_rig, or world_from_video; InputError where there are
    none."""
    out: list[Making] = []
    if settings.depth_from != "video":
        out += _of_pairs(sequence, path, settings)
    if settings.depth_from != "stereo":
        out += _of_video(sequence, path, settings)
    return out


def has_pairs(sequence: Sequence) -> bool:
    """Checks for a stereo camera with frames."""
    return sequence.rig.has_stereo and "stereo" in sequence.kinds


def stereo_pairs(sequence: Sequence) -> list[int]:
    """Indices; InputError where there is none."""
    if not has_pairs(sequence):
        raise InputError(f"{sequence.name} has no stereo pairs: give --depth-from video")
    return _exposures(sequence, "stereo")


def _exposures(sequence: Sequence, kind: Kind) -> list[int]:
    return [i for i, each in enumerate(sequence.kinds) if each == kind]


def _nothing() -> None:
    return None


def _of_pairs(sequence: Sequence, path: Trajectory, settings: DenseSettings) -> list[Making]:
    rig, exposures = sequence.rig, np.array(stereo_pairs(sequence))
    known, poses = _poses(path, sequence.times_ns[exposures], settings.between)
    if not known.any():
        raise InputError(f"{sequence.name}: no stereo pair has a pose: give another --method")
    camera = rig.camera("left")

    def making(n: int) -> Making:
        def made() -> Look | None:
            pair = _read(sequence, int(exposures[n]))
            if pair is None or not is_stereo(pair):
                return None
            depth = DenseStereo().depth(pair.left, pair.right, camera, rig.baseline_m, settings.max_depth)
            return Look(pair.left, depth, camera, poses.pose(n) @ rig.rig_from_left)

        return made

    return [making(n) if known[n] else _nothing for n in range(len(exposures))]


def _of_video(sequence: Sequence, path: Trajectory, settings: DenseSettings) -> list[Making]:
    """Each image that the camera has moved away from the last one, compared with some before and after it."""
    rig, every = sequence.rig, np.array(_exposures(sequence, "video"))
    if rig.video is None or not len(every):
        raise InputError(f"{sequence.name} has no video camera: give --depth-from stereo")
    known, poses = _poses(path, sequence.times_ns[every], settings.between)
    if settings.as_given:
        known = np.isin(sequence.times_ns[every], path.times_ns)
    rig_from_video = rig.rig_from(path.frame).inverse() @ rig.rig_from_video
    exposures, poses = every[known], poses.select(known).moved(right=rig_from_video)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses.translations, axis=0), axis=1))])
    way, camera = way[: len(exposures)], rig.video
    if not len(way) or not way[-1] > 0:
        raise InputError(
            f"{sequence.name}: the video camera does not move, so that it shows no depth: {_cure(settings)}"
        )
    compared = _compared(way / min(settings.baseline, way[-1] / LEAST_BASELINES))
    undistortion = Undistortion.of(camera)
    ideal = _reduced_camera(undistortion.ideal)

    def making(n: int, others: NDArray[np.intp]) -> Making:
        def made() -> Look | None:
            frames = [_read(sequence, int(exposures[k])) for k in (n, *others)]
            images = [_resized(undistortion.image(f.image), ideal) for f in frames if f is not None and is_video(f)]
            if len(images) < len(frames):
                return None
            image, rest = images[0], images[1:]
            seen = [(i, poses.pose(k).inverse() @ poses.pose(n)) for i, k in zip(rest, others, strict=True)]
            nearest = NEAREST_BASELINES * settings.baseline
            depth = PlaneSweep().depth(image, seen, ideal, nearest, settings.max_depth)
            return Look(image, depth, ideal, poses.pose(n))

        return made

    return [making(n, others) for n, others in compared.items()]


def _reduced_camera(camera: Camera) -> Camera:
    """Returns the camera of the image reduced to MAX_PIXELS; the same one where it has no more."""
    factor = (MAX_PIXELS / (camera.width * camera.height)) ** 0.5
    return camera if factor >= 1 else camera.scaled(factor)


def _resized(image: Image, camera: Camera) -> Image:
    """Returns the image in the size of the camera's."""
    if image.shape[:2] == (camera.height, camera.width):
        return image
    return np.asarray(cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA), np.uint8)


def _cure(settings: DenseSettings) -> str:
    return "give a run on more of it" if settings.as_given else "give --depth-from stereo"


def _compared(way: Array) -> dict[int, NDArray[np.intp]]:
    """By index of an image that gets a depth: those that it is compared with. `way` (N,) is the length of the path up
    to each image [baselines]; where images are farther apart than that, neighbours are compared."""
    found: dict[int, NDArray[np.intp]] = {}
    for at in np.arange(max(OTHERS_BASELINES), way[-1] - max(OTHERS_BASELINES), EVERY_BASELINES):
        n = int(np.searchsorted(way, at))
        before, after = (np.searchsorted(way, way[n] + sign * np.array(OTHERS_BASELINES)) for sign in (-1, 1))
        others = np.stack([np.minimum(before, n - 1), np.maximum(after, n + 1)], axis=1).ravel()
        others = np.clip(others, 0, len(way) - 1)
        found[n] = np.array([k for k in dict.fromkeys(others.tolist()) if k != n], np.intp)
    return found


def _poses(path: Trajectory, times_ns: NDArray[np.int64], between: Between) -> tuple[NDArray[np.bool_], Trajectory]:
    """Which times (N,) have poses, and those of all (N)."""
    return known_at(path, times_ns), poses_at(path, times_ns, between)


def _read(sequence: Sequence, exposure: int) -> Measurement | None:
    try:
        return sequence[exposure]
    except UnreadableImage:
        return None


_Made = TypeVar("_Made")


@dataclass(frozen=True, eq=False)
class Dense:
    """In the world of the method that gave the poses."""

    mesh: Mesh
    cloud: Points
    fused: int
    """Looks."""
    skipped: int
    """Those without a pose, or unreadable."""


def dense(looks: Iterable[Making], settings: DenseSettings, advance: Callable[[], None]) -> Dense:
    """Of all looks; `advance` is called after each. InputError where they show no surface."""
    fusion = Fusion(FusionSettings(settings.voxel, settings.memory_gb))
    fused = skipped = 0
    for look in _ahead(_made, looks):
        if look is None:
            skipped += 1
        else:
            fusion.add(look.depth, look.image, look.camera, look.world_from_camera, settings.max_depth)
            fused += 1
        advance()
    mesh = fusion.mesh()
    return Dense(mesh, fusion.cloud(), fused, skipped)


def _made(making: Making) -> Look | None:
    return making()


def _ahead(make: Callable[[Making], _Made], items: Iterable[Making]) -> Iterator[_Made]:
    """What is made of each, in their order; a few at a time."""
    threads, waiting = os.cpu_count() or 1, deque[Future[_Made]]()
    with ThreadPoolExecutor(threads) as pool:
        for item in items:
            waiting.append(pool.submit(make, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
