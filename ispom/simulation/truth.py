"""Ground truth of the simulated cameras: depth, flow and visibility of every pixel, with moving things.

truth = Truth(rendered_source("sim:city?vehicles=6", seed=0))
depth = truth.depth("left", time_ns)
flow, visible = truth.flow("video", time_ns, "left", later_ns)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.simulation.motions import motion_of
from ispom.simulation.places.meshes import MeshPlace
from ispom.simulation.rendering.scene import NOTHING, Scene
from ispom.simulation.source import Source
from ispom.types import Camera, FrameName

SAME = 1e-4
"""Share of its distance by which a point may lie behind what a ray to it hits."""


@dataclass(frozen=True)
class Truth:
    """Ground truth of a source with a global shutter; it includes the delay of the right camera."""

    source: Source

    def __post_init__(self) -> None:
        if self.source.rolling_ns:
            raise ValueError("rows of a rolling shutter have poses of their own: use a source without")

    def camera(self, name: FrameName) -> Camera:
        return self.source.rig.camera(name)

    def pose(self, name: FrameName, time_ns: int) -> Pose:
        """Returns world_from_CAMERA of the frame at a time."""
        rig, motion = self.source.rig, motion_of(self.source.motion, self.source.seed)
        return motion.pose_at(self._exposed(name, time_ns)) @ rig.rig_from(name)

    def depth(self, name: FrameName, time_ns: int) -> Array:
        """Returns z (H, W) [m] in the camera at each pixel's centre, inf for the sky."""
        camera = self.camera(name)
        return self._seen(name, time_ns)[2].reshape(camera.height, camera.width)

    def flow(self, name: FrameName, time_ns: int, other: FrameName, other_ns: int) -> tuple[Array, NDArray[np.bool_]]:
        """Returns the flow (H, W, 2) [px] to another camera or another time, and whether each point is visible there
        (H, W).

        NaN for the sky, and for points behind the other camera.
        """
        camera, target, then = self.camera(name), self.camera(other), self.pose(other, other_ns)
        xyz, triangle, depth = self._seen(name, time_ns)
        if self.source.traffic is not None:
            moment, later = self._exposed(name, time_ns), self._exposed(other, other_ns)
            xyz = xyz + self.source.traffic.shifts(triangle >> 1, moment, later)
        some = np.isfinite(depth)
        uv, in_sight = np.full((len(xyz), 2), np.nan), np.zeros(len(xyz), bool)
        uv[some] = target.project(then.inverse().apply(xyz[some]))
        inside = ((uv >= -0.5) & (uv <= (target.width - 0.5, target.height - 0.5))).all(axis=1)
        scene, index = self._scene(other, other_ns), np.flatnonzero(inside)
        towards = xyz[index] - then.translation
        hits = scene.caster.hits(then.translation, towards.astype(np.float32))
        in_sight[index] = _lengths(scene, hits, then.translation, towards) > 1 - SAME
        pixel = np.stack(np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height))), axis=-1)
        shape = (camera.height, camera.width)
        return uv.reshape(*shape, 2) - pixel, in_sight.reshape(shape)

    def _exposed(self, name: FrameName, time_ns: int) -> int:
        return time_ns + (self.source.right_late_ns if name == "right" else 0)

    def _scene(self, name: FrameName, time_ns: int) -> Scene | MeshPlace:
        traffic = self.source.traffic
        return self.source.scene if traffic is None else traffic.at(self._exposed(name, time_ns))

    def _seen(self, name: FrameName, time_ns: int) -> tuple[Array, NDArray[np.int32], Array]:
        """Returns, for each pixel, the point in the world (N, 3), the triangle (N,) or NOTHING, and z in the camera
        (N,)."""
        camera, pose, scene = self.camera(name), self.pose(name, time_ns), self._scene(name, time_ns)
        u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
        rays = np.column_stack([camera.normalise(np.column_stack([u.ravel(), v.ravel()])), np.ones(u.size)])
        directions = rays @ pose.rotation.T
        hits = scene.caster.hits(pose.translation, directions.astype(np.float32))
        depth = _lengths(scene, hits, pose.translation, directions)
        with np.errstate(invalid="ignore"):
            return pose.translation + depth[:, None] * directions, hits, depth


def _lengths(scene: Scene | MeshPlace, hits: NDArray[np.int32], origin: Array, directions: Array) -> Array:
    """Returns the lengths (N,) of rays to the planes of the triangles that they hit, in units of `directions` (N, 3);
    inf for no hit."""
    out = np.full(len(hits), np.inf)
    some = hits != NOTHING
    first, second, third = np.moveaxis(scene.triangles[hits[some]].astype(float), 1, 0)
    normal = np.cross(second - first, third - first)
    out[some] = ((first - origin) * normal).sum(axis=1) / (directions[some] * normal).sum(axis=1)
    return out
