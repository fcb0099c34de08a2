"""A surface and a cloud as plain arrays, and filters for what is no surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.io.meshes import open3d


@dataclass(frozen=True, eq=False)
class Points:
    """A cloud in some frame."""

    xyz: NDArray[np.float32]
    """(N, 3) [m] in some frame."""
    normals: NDArray[np.float32]
    """(N, 3) unit vectors, towards the cameras."""
    rgb: NDArray[np.uint8]
    """(N, 3)."""

    def __len__(self) -> int:
        return len(self.xyz)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles between points."""

    points: Points
    triangles: NDArray[np.int32]
    """(T, 3) indices, counter-clockwise as seen from outside."""

    def __len__(self) -> int:
        return len(self.triangles)


def without_crumbs(mesh: Any, min_triangles: int) -> Mesh:
    """Returns the connected parts of an Open3D mesh (tensor) with at least `min_triangles`, in a deterministic
    order."""
    legacy = mesh.to_legacy()
    legacy.remove_degenerate_triangles()
    labels, counts, _ = legacy.cluster_connected_triangles()
    large = np.asarray(counts)[np.asarray(labels, int)] >= min_triangles
    legacy.remove_triangles_by_mask(~large)
    legacy.remove_unreferenced_vertices()
    legacy.compute_vertex_normals()
    rgb = np.rint(255 * np.clip(np.asarray(legacy.vertex_colors), 0, 1)).astype(np.uint8)
    xyz, normals = (np.asarray(a, np.float32) for a in (legacy.vertices, legacy.vertex_normals))
    order = _order(xyz)
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    triangles = place[np.asarray(legacy.triangles, np.int32).reshape(-1, 3)]
    return Mesh(Points(xyz[order], normals[order], rgb[order]), triangles[_order(triangles)])


def without_outliers(cloud: Any, neighbours: int = 20, ratio: float = 2.0) -> Points:
    """Returns an Open3D cloud (tensor) without isolated points (Rusu et al. 2008), in a deterministic order."""
    legacy = cloud.to_legacy()
    if len(legacy.points) > neighbours:
        legacy, _ = legacy.remove_statistical_outlier(neighbours, ratio)
    rgb = np.rint(255 * np.clip(np.asarray(legacy.colors), 0, 1)).astype(np.uint8)
    xyz, normals = (np.asarray(a, np.float32) for a in (legacy.points, legacy.normals))
    order = _order(xyz)
    return Points(xyz[order], normals[order], rgb[order])


def simplified(mesh: Mesh, most_triangles: int) -> Mesh:
    """Simplifies the surface to about `most_triangles` (quadric error metrics, Garland and Heckbert 1997)."""
    if len(mesh) <= most_triangles:
        return mesh
    legacy = _as_open3d(mesh).simplify_quadric_decimation(most_triangles)
    legacy.compute_vertex_normals()
    rgb = np.rint(255 * np.clip(np.asarray(legacy.vertex_colors), 0, 1)).astype(np.uint8)
    xyz, normals = (np.asarray(a, np.float32) for a in (legacy.vertices, legacy.vertex_normals))
    return Mesh(Points(xyz, normals, rgb), np.asarray(legacy.triangles, np.int32))


def _as_open3d(mesh: Mesh) -> Any:
    """Returns an `open3d.geometry.TriangleMesh`."""
    o3d = open3d()
    vectors, corners = o3d.utility.Vector3dVector, o3d.utility.Vector3iVector
    legacy = o3d.geometry.TriangleMesh(vectors(mesh.points.xyz.astype(float)), corners(mesh.triangles))
    legacy.vertex_normals = vectors(mesh.points.normals.astype(float))
    legacy.vertex_colors = vectors(mesh.points.rgb / 255.0)
    return legacy


class Surface:
    """Triangles, to measure distances to them."""

    def __init__(self, triangles: NDArray[np.float32]) -> None:
        """Takes triangles (T, 3, 3) by their corners [m]."""
        self._core, self._scene = open3d().core, open3d().t.geometry.RaycastingScene()
        corners = np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3)
        vertices = np.ascontiguousarray(triangles.reshape(-1, 3), np.float32)
        self._scene.add_triangles(self._core.Tensor.from_numpy(vertices), self._core.Tensor.from_numpy(corners))

    def distances(self, xyz: Array) -> NDArray[np.float32]:
        """Returns the distances (N,) [m] of points (N, 3) from the nearest triangle."""
        points = self._core.Tensor.from_numpy(np.ascontiguousarray(xyz, np.float32))
        return self._scene.compute_distance(points).numpy()


def _order(rows: NDArray[Any]) -> NDArray[np.intp]:
    """Returns the order that sorts rows (N, 3): threads finish in any order."""
    return np.lexsort(rows.T[::-1])
