"""A place of triangles: rays by Embree, colours by a function of the surface, each pixel the mean of four samples."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.io.files import expanded, read_bytes
from ispom.io.meshes import ColouredMesh, read_coloured_mesh
from ispom.simulation.rendering.renderer import ROOKS, View
from ispom.simulation.rendering.scene import NOTHING, RayCaster
from ispom.types import Camera, Image

WORD = "mesh:"
"""Prefix of the name of a place from a file."""
MOST_BYTES = 1 << 30
_ROWS = 40
"""Rows of an image that a thread shades at once."""
_LEVELS = 10
"""Levels of a texture pyramid, each half as large as the one before."""
Colour = Callable[[NDArray[np.intp], Array, Array, Array], Array]
"""Maps (N,) triangles, (N, 3) weights of their corners, (N, 3) points in the world, (N,) widths [m] to (N, 3) 0-255."""


@dataclass(frozen=True, eq=False)
class MeshPlace:
    """Triangles with colours, in the axes of their own."""

    triangles: NDArray[np.float32]
    """(T, 3, 3) corners in the world [m]."""
    colour: Colour
    """Colour of a pixel's surface, with light."""
    background: tuple[float, float, float]
    caster: RayCaster
    _views: dict[Camera, View] = field(default_factory=dict)

    def image(
        self, camera: Camera, world_from_camera: Pose, threads: int = 1, rows: Sequence[Pose] | None = None
    ) -> NDArray[np.float32]:
        """Renders (H, W, 3) RGB, 0-255, without noise or rounding; `rows` (H,) camera_from_row of a rolling shutter.

        The result is the same for any number of threads.
        """
        if camera not in self._views:
            self._views[camera] = View.of(camera)
        view = self._views[camera] if rows is None else self._views[camera].rolled(rows)

        def shade(first: int) -> NDArray[np.float32]:
            some = slice(first * camera.width, (first + _ROWS) * camera.width)
            origin = world_from_camera.translation
            if view.start is not None:
                origin = world_from_camera.apply(view.start[:, some].T)
            looks = [self._look(view.change[:, some], world_from_camera.rotation, origin, x, y) for x, y in ROOKS]
            return np.mean(looks, axis=0, dtype=np.float32).reshape(-1, camera.width, 3)

        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(shade, range(0, camera.height, _ROWS))))

    def _look(
        self, change: NDArray[np.float32], rotation: Array, origin: Array, x: float, y: float
    ) -> NDArray[np.float32]:
        """Returns the colours (N, 3) at (x, y) [px] from the centres of N pixels, from `origin` (3,) or (N, 3)."""
        a, b, ra, rb, da, db = change
        rays = np.stack([a + x * ra + y * da, b + x * rb + y * db, np.ones_like(a)], axis=1)
        directions = rays @ rotation.T.astype(np.float32)
        hits = self.caster.hits(origin, directions)
        out = np.empty((len(a), 3), np.float32)
        out[:] = self.background
        seen = np.flatnonzero(hits != NOTHING)
        if len(seen):
            faces = hits[seen].astype(np.intp)
            begin = origin if origin.ndim == 1 else origin[seen]
            xyz, weights, depth = self.met(faces, begin, directions[seen].astype(float))
            width = depth * np.sqrt(np.abs(ra * db - rb * da))[seen] / 2  # four samples per pixel
            out[seen] = self.colour(faces, weights, xyz, width)
        return out

    def met(self, triangle: NDArray[np.intp], origin: Array, directions: Array) -> tuple[Array, Array, Array]:
        """Intersects rays from `origin` (3,) or (N, 3) along `directions` (N, 3) with triangles (N,).

        Returns points in the world (N, 3), weights of the corners (N, 3), and lengths (N,) in units of the directions.
        """
        first, along, up, normal = (part[triangle] for part in self._edges)
        t = ((first - origin) * normal).sum(axis=1) / (directions * normal).sum(axis=1)
        xyz = origin + t[:, None] * directions
        area = (normal * normal).sum(axis=1)
        v = (np.cross(xyz - first, up) * normal).sum(axis=1) / area
        w = (np.cross(along, xyz - first) * normal).sum(axis=1) / area
        return xyz, np.clip(np.stack([1 - v - w, v, w], axis=1), 0, 1), t

    @cached_property
    def _edges(self) -> tuple[Array, Array, Array, Array]:
        """A corner, two edges from there, and their cross product, (T, 3) each."""
        first = self.triangles[:, 0].astype(float)
        along, up = self.triangles[:, 1] - first, self.triangles[:, 2] - first
        return first, along, up, np.cross(along, up)


def mesh_name(path: str) -> str:
    """Returns a name that differs for files of other content. Raises InputError where the file is no mesh."""
    mesh_path = expanded(path).absolute()
    digest = hashlib.blake2b(read_bytes(mesh_path, MOST_BYTES), digest_size=8).hexdigest()
    if len(read_coloured_mesh(mesh_path).triangles) == 0:
        raise InputError(f"{mesh_path} holds no triangles: give a mesh")
    return f"{WORD}{digest}:{mesh_path}"


def mesh_place(name: str) -> MeshPlace:
    """Reads the place of a name of `mesh_name`. Raises InputError where the file is gone."""
    mesh = read_coloured_mesh(Path(name.split(":", 2)[2]))
    caster = RayCaster(mesh.triangles)
    colour = _of_corners(mesh) if mesh.texture is None else _of_texture(mesh, mesh.texture)
    return MeshPlace(mesh.triangles, colour, (200.0, 205.0, 210.0), caster)


def _of_corners(mesh: ColouredMesh) -> Colour:
    rgb = mesh.rgb.astype(np.float32)

    def colour(triangle: NDArray[np.intp], weights: Array, xyz: Array, width_m: Array) -> Array:
        return np.einsum("nk,nkc->nc", weights, rgb[triangle])

    return colour


def _of_texture(mesh: ColouredMesh, texture: Image) -> Colour:
    """Takes colours from a pyramid of the texture, by the size of a sample on it (Williams 1983)."""
    if mesh.uv is None:
        raise ValueError("a mesh with a texture needs texture coordinates")
    uv, levels = mesh.uv.astype(float), [texture.astype(np.float32)]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) > 1:
        height, width = levels[-1].shape[:2]
        size = (max(1, width // 2), max(1, height // 2))
        smaller = np.asarray(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA), np.float32)
        levels.append(smaller.reshape(size[1], size[0], 3))
    texels_per_m = _texels_per_m(mesh, uv, texture)

    def colour(triangle: NDArray[np.intp], weights: Array, xyz: Array, width_m: Array) -> Array:
        at = np.einsum("nk,nkc->nc", weights, uv[triangle])
        level = np.log2(np.maximum(width_m * texels_per_m[triangle], 1)).round().astype(int).clip(0, len(levels) - 1)
        out = np.empty((len(at), 3), np.float32)
        for number in np.unique(level):
            some, image = level == number, levels[number]
            height, width = image.shape[:2]
            x = (at[some, 0] % 1) * width - 0.5
            y = (1 - at[some, 1] % 1) * height - 0.5
            shape = (1, -1)
            places = (x.astype(np.float32).reshape(shape), y.astype(np.float32).reshape(shape))
            out[some] = _at(image, *places)
        return out

    return colour


def _at(image: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Samples the image at (1, N) positions, in pieces that OpenCV accepts; returns (N, 3)."""
    most, pieces = 30_000, []
    for start in range(0, x.shape[1], most):
        some = slice(start, start + most)
        pieces.append(cv2.remap(image, x[:, some], y[:, some], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0])
    return np.concatenate(pieces)


def _texels_per_m(mesh: ColouredMesh, uv: Array, texture: Image) -> Array:
    """Returns texels per metre (T,) by the areas of each triangle in the texture and in the world."""
    height, width = texture.shape[:2]
    one, other = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    texels = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) * width * height
    a, b, c = np.moveaxis(mesh.triangles.astype(float), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.sqrt(texels / np.maximum(area, 1e-12))
