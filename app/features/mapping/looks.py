"""Looks at a place: images with depth and pose, from the stereo pairs of a run or from its video."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, UnreadableImage
from ispom.geometry import Pose
from ispom.reconstruction.depth import DenseStereo, Depth
from ispom.reconstruction.fusion import Fusion, FusionSettings
from ispom.reconstruction.model import Mesh, Points
from ispom.reconstruction.plane_sweep import PlaneSweep, undistorted
from ispom.solvers.trajectory.continuous import Between, known_at, poses_at
from ispom.types import Camera, Image, Kind, Measurement, Sequence, Trajectory, is_stereo, is_video

from .options import From

VOXELS_PER_BASELINE = 10
MAX_DEPTH_BASELINES = 25.0
"""Where a disparity that is 0.25 px wrong puts a point 1 % of 25 baselines off, at a focal length of 600 px."""
NEAREST_BASELINES = 4.0
"""In the video; as DenseStereo has it in pairs."""
EVERY_BASELINES = 1.0
"""From one image of the video that gets a depth to the next,"""
OTHERS_BASELINES = (1.0, 2.0)
"""and from it to those that it is compared with, before and after it."""


@dataclass(frozen=True)
class DenseSettings:
    """How a surface is made."""

    voxel_m: float
    max_depth_m: float
    memory_gb: float
    between: Between
    depth_from: From = "stereo"


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
    """Of the cameras in the settings, with poses world_from_rig; InputError where there are none."""
    out: list[Making] = []
    if settings.depth_from != "video":
        out += _of_pairs(sequence, path, settings)
    if settings.depth_from != "stereo":
        out += _of_video(sequence, path, settings)
    return out


def stereo_pairs(sequence: Sequence) -> list[int]:
    """Indices; InputError where there is none."""
    found = _exposures(sequence, "stereo")
    if not sequence.rig.has_stereo or not found:
        raise InputError(
            f"{sequence.name} has no stereo pairs, which a map is made of: give a run with a stereo camera"
        )
    return found


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
            depth = DenseStereo().depth(pair.left, pair.right, camera, rig.baseline_m, settings.max_depth_m)
            return Look(pair.left, depth, camera, poses.pose(n) @ rig.rig_from_left)

        return made

    return [making(n) if known[n] else _nothing for n in range(len(exposures))]


def _of_video(sequence: Sequence, path: Trajectory, settings: DenseSettings) -> list[Making]:
    """Each image that the camera has moved away from the last one, compared with some before and after it."""
    rig, every = sequence.rig, np.array(_exposures(sequence, "video"))
    if rig.video is None or not len(every):
        raise InputError(f"{sequence.name} has no video camera: give --depth-from stereo")
    known, poses = _poses(path, sequence.times_ns[every], settings.between)
    exposures, poses = every[known], poses.select(known).moved(right=rig.rig_from_video)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses.translations, axis=0), axis=1))])
    way = way[: len(exposures)] / rig.baseline_m
    camera = rig.video

    def making(n: int, others: NDArray[np.intp]) -> Making:
        def made() -> Look | None:
            frames = [_read(sequence, int(exposures[k])) for k in (n, *others)]
            images = [undistorted(f.image, camera) for f in frames if f is not None and is_video(f)]
            if len(images) < len(frames):
                return None
            (image, ideal), rest = images[0], images[1:]
            seen = [(i, poses.pose(k).inverse() @ poses.pose(n)) for (i, _), k in zip(rest, others, strict=True)]
            nearest_m = NEAREST_BASELINES * rig.baseline_m
            depth = PlaneSweep().depth(image, seen, ideal, nearest_m, settings.max_depth_m)
            return Look(image, depth, ideal, poses.pose(n))

        return made

    out: list[Making] = []
    for at in np.arange(max(OTHERS_BASELINES), way[-1] - max(OTHERS_BASELINES) if len(way) else 0, EVERY_BASELINES):
        n = int(np.searchsorted(way, at))
        others = [np.searchsorted(way, way[n] + sign * baseline) for baseline in OTHERS_BASELINES for sign in (-1, 1)]
        out.append(making(n, np.clip(others, 0, len(way) - 1)))
    if not out:
        raise InputError(f"{sequence.name}: the video camera moved too little for depth: give --depth-from stereo")
    return out


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
    fusion = Fusion(FusionSettings(settings.voxel_m, settings.memory_gb))
    fused = skipped = 0
    for look in _ahead(_made, looks):
        if look is None:
            skipped += 1
        else:
            fusion.add(look.depth, look.image, look.camera, look.world_from_camera, settings.max_depth_m)
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
