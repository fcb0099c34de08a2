"""PLY: a cloud with colours and a trajectory as one line."""

from __future__ import annotations

import numpy as np

from ispom.types import Landmarks, Trajectory

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
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
