"""PLY: a cloud with colours and a trajectory as one line; a surface, or a cloud, with normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Landmarks, Trajectory

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
_ORIENTED = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3)])
_TRIANGLE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])
_EDGE = np.dtype([("vertices", "<i4", 2)])


def ply_bytes(landmarks: Landmarks, trajectory: Trajectory, colour: tuple[int, int, int]) -> bytes:
    """Binary: the landmarks' vertices, then the positions of the trajectory in its colour, joined by edges."""
    count, poses = len(landmarks), len(trajectory)
    vertices = np.zeros(count + poses, _VERTEX)
    vertices["xyz"] = np.concatenate([landmarks.xyz_in_world, trajectory.translations])
    vertices["rgb"][:count], vertices["rgb"][count:] = landmarks.rgb, colour
    edges = np.zeros(max(poses - 1, 0), _EDGE)
    edges["vertices"] = count + np.arange(len(edges))[:, None] + (0, 1)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment vertices from {count} on are the trajectory, world_from_{trajectory.frame}",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {channel}" for channel in ("red", "green", "blue")),
        f"element edge {len(edges)}",
        *(f"property int vertex{end}" for end in (1, 2)),
        "end_header",
    ]
    return "\n".join(header).encode() + b"\n" + vertices.tobytes() + edges.tobytes()


def surface_ply(
    xyz: Array, normals: Array, rgb: NDArray[np.uint8], triangles: NDArray[np.int32] | None = None
) -> bytes:
    """Binary: points (N, 3) [m] with unit normals (N, 3) and colours (N, 3), and triangles (T, 3) between them."""
    vertices = np.zeros(len(xyz), _ORIENTED)
    vertices["xyz"], vertices["normal"], vertices["rgb"] = xyz, normals, rgb
    faces = np.zeros(0 if triangles is None else len(triangles), _TRIANGLE)
    if triangles is not None:
        faces["count"], faces["vertices"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", "comment world of the run's trajectory, metres"]
    header += [f"element vertex {len(vertices)}", *(f"property float {axis}" for axis in ("x", "y", "z"))]
    header += [f"property float n{axis}" for axis in "xyz"]
    header += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    if triangles is not None:
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header", ""]).encode() + vertices.tobytes() + faces.tobytes()
