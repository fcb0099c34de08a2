"""The stereo pairs of a run as one surface."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ispom.errors import InputError, UnreadableImage
from ispom.reconstruction.depth import DenseStereo, Depth
from ispom.reconstruction.fusion import Fusion, FusionSettings
from ispom.reconstruction.model import Mesh, Points
from ispom.solvers.trajectory.continuous import Between, known_at, poses_at
from ispom.types import Image, Sequence, StereoPair, Trajectory

_Made = TypeVar("_Made")
VOXELS_PER_BASELINE = 10
MAX_DEPTH_BASELINES = 25.0
"""Where a disparity that is 0.25 px wrong puts a point 1 % of 25 baselines off, at a focal length of 600 px."""


@dataclass(frozen=True)
class DenseSettings:
    voxel_m: float
    max_depth_m: float
    memory_gb: float
    between: Between


@dataclass(frozen=True, eq=False)
class Dense:
    """In the world of the method that gave the poses."""

    mesh: Mesh
    cloud: Points
    pairs: int
    """Fused."""
    skipped: int
    """Pairs without a pose, or unreadable."""


def stereo_pairs(sequence: Sequence) -> list[int]:
    """Indices; InputError where there is none."""
    found = [i for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    if not sequence.rig.has_stereo or not found:
        raise InputError(
            f"{sequence.name} has no stereo pairs, which a map is made of: give a run with a stereo camera"
        )
    return found


def dense(sequence: Sequence, path: Trajectory, settings: DenseSettings, advance: Callable[[], None]) -> Dense:
    """Of all pairs at times with poses world_from_rig; `advance` is called after each. InputError where they show no
    surface."""
    rig, exposures = sequence.rig, np.array(stereo_pairs(sequence))
    times_ns = sequence.times_ns[exposures]
    known = known_at(path, times_ns)
    if not known.any():
        raise InputError(f"{sequence.name}: no stereo pair has a pose: give another --method")
    poses, exposures = poses_at(path, times_ns[known], settings.between), exposures[known]
    camera, fusion = rig.camera("left"), Fusion(FusionSettings(settings.voxel_m, settings.memory_gb))
    fused = 0

    def seen(exposure: int) -> tuple[Image, Depth] | None:
        try:
            pair = sequence[exposure]
        except UnreadableImage:
            return None
        assert isinstance(pair, StereoPair)
        return pair.left, DenseStereo().depth(pair.left, pair.right, camera, rig.baseline_m, settings.max_depth_m)

    for n, found in enumerate(_ahead(seen, exposures.tolist())):
        if found is not None:
            image, depth = found
            fusion.add(depth, image, camera, poses.pose(n) @ rig.rig_from_left, settings.max_depth_m)
            fused += 1
        advance()
    mesh = fusion.mesh()
    return Dense(mesh, fusion.cloud(), fused, len(times_ns) - fused)


def _ahead(make: Callable[[int], _Made], items: Iterable[int]) -> Iterator[_Made]:
    """What is made of each, in their order; a few at a time."""
    threads, waiting = os.cpu_count() or 1, deque[Future[_Made]]()
    with ThreadPoolExecutor(threads) as pool:
        for item in items:
            waiting.append(pool.submit(make, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
