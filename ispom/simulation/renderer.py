"""Images and depth of a scene: rays cast by Open3D (Embree), shaded here, with extra samples only where faces meet."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import open3d as o3d
from numba import njit
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.simulation.materials import sky, surface
from ispom.simulation.noise import FAST
from ispom.simulation.scene import Scene
from ispom.types import Camera, Image

SKY = -1
_BAND_RAYS = 60_000
"""Rays per cast: Open3D keeps Python's lock meanwhile, and others want it within a few milliseconds."""
_SPREAD = 1.25
"""Width of the pixel's box filter [px]: a little over one, as lens and sensor blur it."""
_ROOKS = (np.stack([np.arange(8), np.array([3, 6, 1, 4, 7, 2, 5, 0])], axis=1) + 0.5) / 8 - 0.5
"""(8, 2) extra samples of an edge pixel [px]: all columns and all rows differ."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera's rays, on the plane z = 1 of the camera."""

    rays: Array
    """(H, W, 2) of the pixel centres."""
    right: Array
    """(H, W, 2) change of the ray per pixel to the right."""
    down: Array
    """(H, W, 2) change of the ray per pixel down."""

    @staticmethod
    def of(camera: Camera) -> View:
        u, v = np.meshgrid(np.arange(-1, camera.width + 1.0), np.arange(-1, camera.height + 1.0))
        rays = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(*u.shape, 2)
        right, down = (rays[1:-1, 2:] - rays[1:-1, :-2]) / 2, (rays[2:, 1:-1] - rays[:-2, 1:-1]) / 2
        return View(*(np.ascontiguousarray(a) for a in (rays[1:-1, 1:-1], right, down)))


@dataclass(frozen=True, eq=False)
class Renderer:
    """Renders one scene. Same input, same bytes, whatever the number of threads."""

    scene: Scene
    _views: dict[Camera, View] = field(default_factory=dict)

    def view(self, camera: Camera) -> View:
        if camera not in self._views:
            self._views[camera] = View.of(camera)
        return self._views[camera]

    def faces(self, camera: Camera, world_from_camera: Pose, threads: int = 1) -> NDArray[np.int32]:
        """(H, W) the face behind each pixel's centre, SKY where none."""
        rays = self.view(camera).rays
        directions = np.empty((camera.height, camera.width, 6), np.float32)
        _fill_rays(rays, world_from_camera.rotation, world_from_camera.translation, directions)
        return self._cast(directions.reshape(-1, 6), threads).reshape(camera.height, camera.width)

    def depth(self, camera: Camera, world_from_camera: Pose) -> Array:
        """(H, W) z [m] in the camera of what each pixel's centre sees, inf for the sky."""
        out = np.empty((camera.height, camera.width))
        faces, scene = self.faces(camera, world_from_camera), self.scene
        _depths(
            self.view(camera).rays,
            world_from_camera.rotation,
            world_from_camera.translation,
            faces,
            scene.corner,
            scene.axes,
            out,
        )
        return out

    def image(self, camera: Camera, world_from_camera: Pose, threads: int = 1) -> NDArray[np.float32]:
        """(H, W, 3) RGB, 0-255 without noise or rounding."""
        view, faces = self.view(camera), self.faces(camera, world_from_camera, threads)
        r, o, s = world_from_camera.rotation, world_from_camera.translation, self.scene
        edge = _edges(faces)
        where = np.argwhere(edge)
        slot = np.full(faces.shape, -1, np.int32)
        slot[edge] = np.arange(len(where))
        samples = np.empty((len(where), len(_ROOKS), 6), np.float32)
        _fill_samples(view.rays, view.right, view.down, r, o, where, _ROOKS, samples)
        hits = self._cast(samples.reshape(-1, 6), threads).reshape(len(where), len(_ROOKS))
        out = np.empty((*faces.shape, 3), np.float32)

        def shade(rows: NDArray[np.int64]) -> None:
            _shade(
                view.rays, view.right, view.down, r, o, faces, slot, hits, _ROOKS, rows[0], rows[-1] + 1,
                s.corner, s.axes, s.material, s.seed, s.parameters, s.light, s.grain, out,
            )  # fmt: skip

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(shade, np.array_split(np.arange(camera.height), min(camera.height, 8 * threads))))
        return out

    def _cast(self, rays: NDArray[np.float32], threads: int) -> NDArray[np.int32]:
        out = np.empty(len(rays), np.int32)
        for a in range(0, len(rays), _BAND_RAYS):
            found = self.scene.caster.cast_rays(o3d.core.Tensor.from_numpy(rays[a : a + _BAND_RAYS]), nthreads=threads)
            ids = found["primitive_ids"].numpy()
            out[a : a + _BAND_RAYS] = np.where(ids == np.iinfo(np.uint32).max, SKY, ids // 2)
        return out


def exposed(image: NDArray[np.float32], noise_seed: int, sigma: float) -> Image:
    """The uint8 image that a sensor with Gaussian-like noise of `sigma` [grey levels] reads out."""
    out = np.empty(image.shape, np.uint8)
    _read_out(image, noise_seed, sigma, out)
    return out


def _edges(faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(H, W) whether any of the eight neighbours shows another face."""
    padded = np.pad(faces, 1, mode="edge")
    h, w = faces.shape
    edge = np.zeros((h, w), bool)
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            edge |= padded[dy : dy + h, dx : dx + w] != faces
    return edge


@njit(**FAST)
def _fill_rays(rays, r, o, out):
    for y in range(rays.shape[0]):
        for x in range(rays.shape[1]):
            a, b = rays[y, x]
            for k in range(3):
                out[y, x, k] = o[k]
                out[y, x, 3 + k] = r[k, 0] * a + r[k, 1] * b + r[k, 2]


@njit(**FAST)
def _fill_samples(rays, right, down, r, o, edges, offsets, out):
    for e in range(len(edges)):
        y, x = edges[e]
        for n in range(len(offsets)):
            dx, dy = offsets[n]
            a = rays[y, x, 0] + dx * right[y, x, 0] + dy * down[y, x, 0]
            b = rays[y, x, 1] + dx * right[y, x, 1] + dy * down[y, x, 1]
            for k in range(3):
                out[e, n, k] = o[k]
                out[e, n, 3 + k] = r[k, 0] * a + r[k, 1] * b + r[k, 2]


@njit(**FAST)
def _hit(r, o, corner, axis, a, b):
    """Depth of the ray (a, b, 1) of the camera on a face's plane, and where (u, v) [m]."""
    dx, dy = r[0, 0] * a + r[0, 1] * b + r[0, 2], r[1, 0] * a + r[1, 1] * b + r[1, 2]
    dz = r[2, 0] * a + r[2, 1] * b + r[2, 2]
    px, py, pz = o[0] - corner[0], o[1] - corner[1], o[2] - corner[2]
    t = -(axis[2, 0] * px + axis[2, 1] * py + axis[2, 2] * pz) / (axis[2, 0] * dx + axis[2, 1] * dy + axis[2, 2] * dz)
    px, py, pz = px + t * dx, py + t * dy, pz + t * dz
    return (
        t,
        axis[0, 0] * px + axis[0, 1] * py + axis[0, 2] * pz,
        axis[1, 0] * px + axis[1, 1] * py + axis[1, 2] * pz,
    )


@njit(**FAST)
def _colour(a, b, ra, rb, da, db, r, o, face, corner, axes, material, seed, parameters, light, texels):
    """Colour of a face (or the sky) along the ray (a, b, 1), over the pixel spanned by (ra, rb) and (da, db)."""
    if face < 0:
        x, y, z = (
            r[0, 0] * a + r[0, 1] * b + r[0, 2],
            r[1, 0] * a + r[1, 1] * b + r[1, 2],
            r[2, 0] * a + r[2, 1] * b + r[2, 2],
        )
        return sky(texels, x, y, z, math.sqrt(abs(ra * db - rb * da)))
    t, u, v = _hit(r, o, corner[face], axes[face], a, b)
    _, u1, v1 = _hit(r, o, corner[face], axes[face], a + ra, b + rb)
    _, u2, v2 = _hit(r, o, corner[face], axes[face], a + da, b + db)
    u1, v1, u2, v2 = _SPREAD * (u1 - u), _SPREAD * (v1 - v), _SPREAD * (u2 - u), _SPREAD * (v2 - v)
    long, short = math.hypot(u1, v1), math.hypot(u2, v2)
    if long < short:
        u1, v1, u2, v2, long, short = u2, v2, u1, v1, short, long
    count = int(min(4.0, max(1.0, math.ceil(long / (1.5 * short) - 0.2))))
    u1, v1 = u1 / count, v1 / count
    wu, wv = abs(u1) + abs(u2), abs(v1) + abs(v2)
    wu, wv = max(wu, 0.1 * wv), max(wv, 0.1 * wu)
    red, green, blue = 0.0, 0.0, 0.0
    for n in range(count):
        step = n - 0.5 * (count - 1)
        x, y, z = surface(texels, material[face], parameters[face], seed[face], u + step * u1, v + step * v1, wu, wv)
        red, green, blue = red + x, green + y, blue + z
    factor = light[face] / count
    haze = 1.0 - math.exp(-t / 260.0)
    return (
        red * factor + (205.0 - red * factor) * haze,
        green * factor + (215.0 - green * factor) * haze,
        blue * factor + (228.0 - blue * factor) * haze,
    )


@njit(**FAST)
def _shade(
    rays, right, down, r, o, faces, slot, hits, offsets, y0, y1,
    corner, axes, material, seed, parameters, light, texels, out,
):  # fmt: skip
    """Rows y0..y1-1. A pixel where faces meet is the mean of its parts, one look at each face that its samples hit."""
    for y in range(y0, y1):
        for x in range(rays.shape[1]):
            edge = slot[y, x]
            count = 1 if edge < 0 else len(offsets)
            ra, rb, da, db = right[y, x, 0], right[y, x, 1], down[y, x, 0], down[y, x, 1]
            red, green, blue = 0.0, 0.0, 0.0
            for n in range(count):
                face, alike, dx, dy = faces[y, x], 1, 0.0, 0.0
                if edge >= 0:
                    face, alike = hits[edge, n], 0
                    for m in range(count):
                        if hits[edge, m] == face:
                            if m < n:  # seen already
                                break
                            alike, dx, dy = alike + 1, dx + offsets[m, 0], dy + offsets[m, 1]
                    if alike == 0:
                        continue
                    dx, dy = dx / alike, dy / alike
                size = math.sqrt(alike / count)
                p, q, s = _colour(
                    rays[y, x, 0] + dx * ra + dy * da, rays[y, x, 1] + dx * rb + dy * db,
                    size * ra, size * rb, size * da, size * db,
                    r, o, face, corner, axes, material, seed, parameters, light, texels,
                )  # fmt: skip
                red, green, blue = red + alike * p, green + alike * q, blue + alike * s
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / count, green / count, blue / count


@njit(**FAST)
def _depths(rays, r, o, faces, corner, axes, out):
    for y in range(rays.shape[0]):
        for x in range(rays.shape[1]):
            out[y, x] = np.inf
            if faces[y, x] >= 0:
                out[y, x] = _hit(r, o, corner[faces[y, x]], axes[faces[y, x]], rays[y, x, 0], rays[y, x, 1])[0]


@njit(**FAST)
def _read_out(image, noise_seed, sigma, out):
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            for c in range(3):
                h = ((3 * x + c) * 73856093) ^ (y * 19349663) ^ (noise_seed * 83492791)
                h = (h ^ (h >> 15)) * 2246822519
                h = (h ^ (h >> 13)) * 3266489917
                h = h ^ (h >> 16)
                total = (h & 255) + ((h >> 8) & 255) + ((h >> 16) & 255) + ((h >> 24) & 255)  # of four: nearly Gaussian
                value = image[y, x, c] + sigma * (total - 510.0) / 147.8
                out[y, x, c] = int(min(255.0, max(0.0, value + 0.5)))
