"""The images of a run as one surface: looks at the place, each with its depth, fused."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from ispom.reconstruction.fusion import Fusion, FusionSettings
from ispom.reconstruction.model import Mesh, Points

from .looks import DenseSettings, Look, Making

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
