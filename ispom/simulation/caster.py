"""Which triangle a ray hits first, by Intel's Embree: `embreex` where it has wheels, else the one inside Open3D."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array

NOTHING = -1
"""What a ray hits that goes past everything."""
_BAND_RAYS = 60_000
"""Rays that a thread casts before it takes the next ones."""

Rays = NDArray[np.float32]
Cast = Callable[[Rays, Rays], NDArray[np.int32]]
"""(N, 3) origins and (N, 3) directions to (N,) indices of triangles."""


class RayCaster:
    """Triangles, ready for rays. Safe from several threads; the same answers for any number of them."""

    def __init__(self, triangles: Rays, prepare: Callable[[Rays], Cast] | None = None) -> None:
        """Of triangles (T, 3, 3) by their corners [m]. InputError where no library for it can be loaded."""
        self._cast = (prepare or (by_embreex if find_spec("embreex") else by_open3d))(triangles)
        # The first cast builds Embree's tree: here, before there are several threads.
        self.hits(np.zeros(3), np.ones((1, 3), np.float32))

    def hits(self, origin: Array, directions: Rays, threads: int = 1) -> NDArray[np.int32]:
        """(N,) indices of what rays from `origin` (3,) or (N, 3) [m] along `directions` (N, 3) hit, or NOTHING."""
        out = np.empty(len(directions), np.int32)
        origins = np.broadcast_to(np.asarray(origin, np.float32), directions.shape)

        def cast(start: int) -> None:
            band = slice(start, start + _BAND_RAYS)
            out[band] = self._cast(origins[band], directions[band])

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(cast, range(0, len(directions), _BAND_RAYS)))
        return out


def by_embreex(triangles: Rays) -> Cast:
    """Wheels for Linux on x86-64, macOS and Windows, which need nothing of the system."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(triangles, np.float32))
    return scene.run


def by_open3d(triangles: Rays) -> Cast:
    """Linux on ARM has wheels of nothing else."""
    from ispom.io.open3d import open3d

    core, scene = open3d().core, open3d().t.geometry.RaycastingScene(nthreads=1)
    corners = np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(
        core.Tensor.from_numpy(np.ascontiguousarray(triangles.reshape(-1, 3))), core.Tensor.from_numpy(corners)
    )

    def cast(origins: Rays, directions: Rays) -> NDArray[np.int32]:
        rays = core.Tensor.from_numpy(np.concatenate([origins, directions], axis=1))
        found = scene.cast_rays(rays, nthreads=1)["primitive_ids"]
        return found.numpy().view(np.int32)  # what hits nothing has the largest number: -1 as a signed one

    return cast
