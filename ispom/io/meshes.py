"""Meshes and clouds as files of other tools: PLY and glTF; and a user's mesh with its texture, by trimesh."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.files import names, read_bytes, require_file
from ispom.types import Image

GLTF_FROM_WORLD = Pose(np.diag([1.0, -1.0, -1.0]))
"""glTF's y axis points up and its z axis to the viewer; here y points down, and z ahead."""
ENDINGS = (".ply", ".obj", ".glb", ".gltf", ".stl")
COMPANION_BYTES = 256 << 20
"""Of a file that a mesh names."""
PLAIN = (160, 160, 160)
"""Colour of a mesh without one."""


@dataclass(frozen=True, eq=False)
class ColouredMesh:
    """Triangles with a texture, or with a colour at each corner."""

    triangles: NDArray[np.float32]
    """(T, 3, 3) corners [m], counter-clockwise as seen from outside."""
    rgb: NDArray[np.uint8]
    """(T, 3, 3) of the corners; white where a texture says more."""
    uv: NDArray[np.float32] | None = None
    """(T, 3, 2) of the corners in the texture, 0..1, (0, 0) at its lower left; None without one."""
    texture: Image | None = None
    """(H, W, 3)."""


def glb_bytes(xyz: Array, normals: Array, rgb: NDArray[np.uint8], triangles: NDArray[np.int32]) -> bytes:
    """A binary glTF file of points (N, 3) [m] of our world, with normals (N, 3), colours (N, 3), triangles (T, 3)."""
    import trimesh

    moved, turned = GLTF_FROM_WORLD.apply(np.asarray(xyz, float)), normals @ GLTF_FROM_WORLD.rotation.T
    mesh = trimesh.Trimesh(moved, triangles, vertex_normals=turned, vertex_colors=rgb, process=False)
    content = mesh.export(file_type="glb", include_normals=True)
    assert isinstance(content, bytes)
    return content


def read_coloured_mesh(path: Path) -> ColouredMesh:
    """Of a PLY, OBJ, glTF or STL file, in its own axes. InputError where it is none, or holds no triangle."""
    import trimesh

    require_file(path)
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path} is no mesh: give a file that ends with one of {', '.join(ENDINGS)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = trimesh.load(path, force="mesh", process=False, resolver=_companions(path))
    except InputError:
        raise
    except Exception as error:  # its parsers raise a dozen kinds on damaged bytes
        raise InputError(f"{path} is damaged, or no mesh ({type(error).__name__}): give another file") from None
    if not isinstance(loaded, trimesh.Trimesh) or not len(loaded.faces) or not np.isfinite(loaded.vertices).all():
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
    return ColouredMesh(triangles, np.broadcast_to(np.array(PLAIN, np.uint8), (*faces.shape, 3)))


def _companions(path: Path) -> Any:
    """What trimesh reads the files through that a mesh names, such as its texture: those of its own folder only, links
    followed, of bounded size. Its own reader waits for pipes, and in some versions takes any path."""
    from trimesh.resolvers import Resolver

    folder = Path(os.path.realpath(path.parent))

    class Companions(Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            found = Path(os.path.realpath(folder / key.strip()))
            if not found.is_relative_to(folder):
                raise InputError(f"{path} names {key[:60]!r}, which is outside of its folder: put the file beside it")
            return read_bytes(found, COMPANION_BYTES)

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
