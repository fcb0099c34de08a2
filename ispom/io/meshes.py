"""Meshes and point clouds: PLY with colours, normals or a trajectory; textured meshes; Open3D on demand."""

from __future__ import annotations

import os
import re
import warnings
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.files import names, read_bytes, require_file
from ispom.io.values import LARGEST
from ispom.types import Image, Landmarks, Trajectory, WorldLines

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
_ORIENTED = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3)])
_TRIANGLE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])
_EDGE = np.dtype([("vertices", "<i4", 2)])


def ply_bytes(
    landmarks: Landmarks,
    trajectory: Trajectory,
    colour: tuple[int, int, int],
    lines: WorldLines | None = None,
    line_rgb: NDArray[np.uint8] | None = None,
) -> bytes:
    """Returns a binary PLY: the landmarks as vertices, then the positions of the trajectory in its colour, joined by
    edges, then both ends of each of the L lines of the scene in their colours (L, 3), joined by edges."""
    ends = np.zeros((0, 3)) if lines is None else lines.xyz_in_world.reshape(-1, 3)
    count, poses = len(landmarks), len(trajectory)
    vertices = np.zeros(count + poses + len(ends), _VERTEX)
    vertices["xyz"] = np.concatenate([landmarks.xyz_in_world, trajectory.translations, ends])
    vertices["rgb"][:count], vertices["rgb"][count:] = landmarks.rgb, colour
    if line_rgb is not None:
        vertices["rgb"][count + poses :] = np.repeat(line_rgb, 2, axis=0)
    starts = np.concatenate([np.arange(max(poses - 1, 0)), poses + np.arange(0, len(ends), 2)])
    edges = np.zeros(len(starts), _EDGE)
    edges["vertices"] = count + starts[:, None] + (0, 1)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment vertices from {count} on are the trajectory, world_from_{trajectory.frame}",
        *([f"comment vertices from {count + poses} on are the ends of lines of the scene"] if len(ends) else []),
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
    """Writes points (N, 3) [m] with unit normals (N, 3) and colours (N, 3), and triangles (T, 3) between them, as
    binary."""
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


# Meshes and clouds as files of other tools: PLY and glTF; and a user's mesh with its texture, by trimesh.


GLTF_FROM_WORLD = Pose(np.diag([1.0, -1.0, -1.0]))
"""glTF's y axis points up and its z axis backwards; here y points down, and z forward."""
MESH_SUFFIXES = (".ply", ".obj", ".glb", ".gltf", ".stl")
MAX_COMPANION_BYTES = 256 << 20
"""Largest size of a file that a mesh refers to."""
DEFAULT_RGB = (160, 160, 160)
"""Colour of a mesh without one."""


@dataclass(frozen=True, eq=False)
class ColouredMesh:
    """Triangles with a texture, or with a colour at each corner."""

    triangles: NDArray[np.float32]
    """(T, 3, 3) corners [m], counter-clockwise as seen from outside."""
    rgb: NDArray[np.uint8]
    """(T, 3, 3) colours of the corners; white where there is a texture."""
    uv: NDArray[np.float32] | None = None
    """(T, 3, 2) positions of the corners in the texture, 0 to 1, (0, 0) at its lower left; None without one."""
    texture: Image | None = None
    """(H, W, 3) RGB."""


def glb_bytes(xyz: Array, normals: Array, rgb: NDArray[np.uint8], triangles: NDArray[np.int32]) -> bytes:
    """Returns a binary glTF file of points (N, 3) [m] of our world, with normals (N, 3), colours (N, 3), triangles
    (T, 3)."""
    import trimesh

    moved, turned = GLTF_FROM_WORLD.apply(np.asarray(xyz, float)), normals @ GLTF_FROM_WORLD.rotation.T
    mesh = trimesh.Trimesh(moved, triangles, vertex_normals=turned, vertex_colors=rgb, process=False)
    return bytes(mesh.export(file_type="glb", include_normals=True))  # type: ignore[arg-type]


def read_coloured_mesh(path: Path) -> ColouredMesh:
    """Reads a PLY, OBJ, glTF or STL file, in its own axes. Raises InputError where it is none, or has no triangle."""
    import trimesh

    require_file(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path} is no mesh: give a file that ends with one of {', '.join(MESH_SUFFIXES)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = trimesh.load(path, force="mesh", process=False, resolver=_companions(path))
    except InputError:
        raise
    except Exception as error:  # its parsers raise a dozen kinds on damaged bytes
        raise InputError(f"{path} is damaged, or no mesh ({type(error).__name__}): give another file") from None
    if not isinstance(loaded, trimesh.Trimesh) or not len(loaded.faces) or not (abs(loaded.vertices) <= LARGEST).all():
        raise InputError(f"{path} holds no triangles: give a mesh, not points")
    faces = np.asarray(loaded.faces)
    triangles = np.asarray(loaded.vertices, np.float32)[faces]
    visual: Any = loaded.visual
    uv, image = getattr(visual, "uv", None), _texture(visual)
    if uv is not None and image is not None:
        white = np.full((*faces.shape, 3), 255, np.uint8)
        return ColouredMesh(triangles, white, np.asarray(uv, np.float32)[faces], image)
    if visual.kind == "vertex":
        return ColouredMesh(triangles, np.asarray(visual.vertex_colors)[faces][..., :3].astype(np.uint8))
    if visual.kind == "face":
        return ColouredMesh(triangles, np.repeat(np.asarray(visual.face_colors)[:, None, :3], 3, axis=1))
    return ColouredMesh(triangles, np.broadcast_to(np.array(DEFAULT_RGB, np.uint8), (*faces.shape, 3)))


def _companions(path: Path) -> Any:
    """Returns trimesh's resolver for the files that a mesh refers to, such as its texture: only files in its own
    folder, links followed, of bounded size. The resolver of trimesh blocks on pipes, and in some versions opens any
    path."""
    from trimesh.resolvers import Resolver

    folder = Path(os.path.realpath(path.parent))

    class Companions(Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            real_path = Path(os.path.realpath(folder / key.strip()))
            if not real_path.is_relative_to(folder):
                raise InputError(f"{path} names {key[:60]!r}, which is outside of its folder: move the file into it")
            return read_bytes(real_path, MAX_COMPANION_BYTES)

        def keys(self) -> list[str]:
            return names(folder)

        def namespaced(self, namespace: str) -> Any:
            return self

        def write(self, name: str, data: Any) -> None:
            raise NotImplementedError

    return Companions()


def _texture(visual: Any) -> Image | None:
    material = getattr(visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    return None if image is None else np.asarray(image.convert("RGB"), np.uint8)


# Open3D is imported only where it is needed: its wheel loads system libraries that slim machines do not have.


def open3d() -> ModuleType:
    """Imports and returns the module `open3d`. Raises InputError where it, or a system library that it loads, is
    missing."""
    try:
        return import_module("open3d")
    except ModuleNotFoundError as error:
        if error.name != "open3d":
            raise
        raise InputError("this needs Open3D, which is not installed: run 'pip install open3d'") from error
    except (ImportError, OSError) as error:  # "libX.so.1: cannot open shared object file: ..."
        library = re.search(r"[\w.+-]+\.so[.\d]*", str(error))
        if library is None:
            raise InputError(f"Open3D cannot be loaded ({error}): install it again") from error
        raise InputError(
            f"Open3D cannot load the system library {library[0]}: install it (on Debian and Ubuntu: "
            "'apt-get install libusb-1.0-0 libegl1 libgl1 libx11-6 libidn2-0 libudev1 libgomp1')"
        ) from error
