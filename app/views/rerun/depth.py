"""Dense depth of a stereo pair as points of the 3-D view, in the pose of a metric method."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.methods import method as registered
from ispom.reconstruction.depth import DenseStereo
from ispom.types import Frame, Rig, Step

from . import entities
from .batch import Entry

MOST_POINTS = 20_000
FARTHEST_BASELINES = 50.0
"""Largest distance of points, in baselines: there, an error of 0.25 px of the disparity is one of 2 % of the distance,
at a focal length of 600 px."""
POINT_PX = 1.0
"""Half width on the screen."""


def depth_entries(pair: Frame, steps: Sequence[Step], rig: Rig, hidden: Collection[str] = ()) -> Iterator[Entry]:
    """Yields at most one entry: the points of the pair, below a metric method with a pose at the pair that is not
    `hidden`. Of several methods it is the one that uses most sensors."""
    posed = [s for s in steps if s.world_from_frame is not None and s.method not in hidden]
    metric = [s for s in posed if registered(s.method).unit == "metric"]
    step = max(metric, key=lambda s: len(registered(s.method).sensors), default=None)
    if step is None or step.world_from_frame is None or not pair.left.size or not pair.right.size:
        return
    xyz_in_left, rgb = depth_points(pair, rig)
    world_from_left = step.world_from_frame @ rig.rig_from(step.frame).inverse() @ rig.rig_from_left
    drawn = rr.Points3D(world_from_left.apply(xyz_in_left), colors=rgb, radii=[-POINT_PX])
    yield Entry(f"world/{step.method}/depth", drawn)


def depth_points(pair: Frame, rig: Rig) -> tuple[Array, NDArray[np.uint8]]:
    """Points (N, 3) in the left camera [m] and their colours (N, 3), spread evenly over the image. Large images are
    matched at the size at which they are shown."""
    height, width = pair.left.shape[:2]
    scale = entities.shown_scale(width, height)
    size = (round(scale * width), round(scale * height))
    left, right = (cv2.resize(i, size, interpolation=cv2.INTER_AREA) for i in (pair.left, pair.right))
    camera = rig.camera("left").scaled(scale)
    depth = DenseStereo().depth(left, right, camera, rig.baseline_m, FARTHEST_BASELINES * rig.baseline_m)  # type: ignore[arg-type]
    stride = 1
    while np.count_nonzero(depth[::stride, ::stride]) > MOST_POINTS:
        stride += 1
    v, u = stride * np.stack(np.nonzero(depth[::stride, ::stride]))
    rays = np.column_stack([camera.normalise(np.column_stack([u, v]).astype(float)), np.ones(len(u))])
    rgb = left[v, u] if left.ndim == 3 else np.repeat(left[v, u][:, None], 3, axis=1)
    return rays * depth[v, u][:, None], np.asarray(rgb, np.uint8)
