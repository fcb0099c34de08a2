"""Images and depth of a scene: rays cast by Embree, shaded here, with extra samples only where faces meet."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.simulation.rendering.materials import sky
from ispom.simulation.rendering.noise import Values
from ispom.simulation.rendering.scene import NOTHING, Scene
from ispom.types import Camera, Image


@dataclass(frozen=True, eq=False)
class View:
    """A camera's rays, on the plane z = 1 of the camera."""

    rays: Array
    """(H, W, 2) rays of the pixel centres."""
    change: Values
    """(6, H W) the rays again, their change per pixel to the right, and per pixel down."""
    start: Values | None = None
    """(3, H W) where the rays begin [m], if not in the camera's centre."""

    @staticmethod
    def of(camera: Camera) -> View:
        u, v = np.meshgrid(np.arange(-1, camera.width + 1.0), np.arange(-1, camera.height + 1.0))
        rays = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(*u.shape, 2)
        right, down = (rays[1:-1, 2:] - rays[1:-1, :-2]) / 2, (rays[2:, 1:-1] - rays[:-2, 1:-1]) / 2
        rays = np.ascontiguousarray(rays[1:-1, 1:-1])
        change = np.concatenate([a.reshape(-1, 2).T for a in (rays, right, down)]).astype(np.float32, order="C")
        return View(rays, change)

    def rolled(self, middle_from_row: Sequence[Pose]) -> View:
        """Returns the rays in the camera of the middle row, for rows (H,) with poses of their own."""
        height, width = self.rays.shape[:2]
        turn = np.stack([pose.rotation for pose in middle_from_row])
        right, down = self.change[2:].astype(float).reshape(2, 2, height, width).transpose(0, 2, 3, 1)
        rays = _turned(turn, self.rays)
        changes = (_turned(turn, self.rays + change) - rays for change in (right, down))
        change = np.concatenate([a.reshape(-1, 2).T for a in (rays, *changes)]).astype(np.float32, order="C")
        start = np.stack([pose.translation for pose in middle_from_row]).astype(np.float32)
        return View(rays, change, np.ascontiguousarray(np.repeat(start, width, axis=0).T))


def _turned(turn: Array, rays: Array) -> Array:
    """Rotates rays (H, W, 2) of rows by rotations (H, 3, 3)."""
    out = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) @ turn.transpose(0, 2, 1)
    return np.asarray(out[..., :2] / out[..., 2:])


ROOKS = np.array([[-0.375, 0.125], [0.125, 0.375], [0.375, -0.125], [-0.125, -0.375]], np.float32)
"""(4, 2) extra samples of an edge pixel [px]: all columns and all rows differ."""


def edges(faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Returns (H, W) whether any of the eight neighbours shows another face."""
    edge = np.zeros(faces.shape, bool)
    h, w = faces.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = slice(0, h - dy), slice(max(0, -dx), w - max(0, dx))
        there = slice(dy, h), slice(max(0, dx), w + min(0, dx))
        differs = faces[here] != faces[there]
        edge[here] |= differs
        edge[there] |= differs
    return edge


@dataclass(frozen=True, eq=False)
class Samples:
    """One sample for each face that a pixel shows: first the pixels within a face, then the edge pixels."""

    inner: NDArray[np.intp]
    """(I,) pixels of an image read row by row."""
    outer: NDArray[np.intp]
    """(E,) edge pixels."""
    starts: NDArray[np.intp]
    """(E,) index of the first sample of an edge pixel, after those I."""
    pixel: NDArray[np.intp]
    """(N,) pixel of each sample."""
    face: NDArray[np.int32]
    dx: Values
    """(N,) offset from the pixel's centre [px]."""
    dy: Values
    share: Values
    """(N,) share of the pixel that shows this face."""

    @staticmethod
    def of(faces: NDArray[np.int32], edge: NDArray[np.bool_], hits: NDArray[np.int32]) -> Samples:
        """Makes samples from the faces (H, W) behind centres, and those (E, R) that ROOKS of the edge pixels hit."""
        inner, outer, count = np.flatnonzero(~edge), np.flatnonzero(edge), len(ROOKS)
        # Sort by face within a pixel; the lowest digits keep the index in ROOKS.
        mixed = np.sort((hits + 1) * count + np.arange(count, dtype=np.int32), axis=1).ravel()
        face, which = mixed // count - 1, mixed % count
        first = np.diff(face, prepend=-2) != 0
        first[::count] = True
        runs = np.flatnonzero(first)
        run_lengths = np.diff(runs, append=len(mixed)).astype(np.float32)
        dx, dy = (np.add.reduceat(a[which], runs) / run_lengths if len(runs) else run_lengths for a in ROOKS.T)
        still = np.zeros(len(inner), np.float32)
        return Samples(
            inner=inner,
            outer=outer,
            starts=np.flatnonzero(runs % count == 0),
            pixel=np.concatenate([inner, outer[runs // count]]),
            face=np.concatenate([faces.ravel()[inner], face[runs]]),
            dx=np.concatenate([still, dx]),
            dy=np.concatenate([still, dy]),
            share=np.concatenate([still + 1, run_lengths / count]),
        )

    def mean(self, colour: Values) -> Values:
        """Returns the pixels (H W, 3) from the colours (N, 3) of all samples."""
        out = np.empty((len(self.inner) + len(self.outer), 3), np.float32)
        n = len(self.inner)
        out[self.inner] = colour[:n]
        if len(self.outer):
            out[self.outer] = np.add.reduceat(colour[n:] * self.share[n:, None], self.starts, axis=0)
        return out


# Images and depth of a scene: rays cast by Embree, shaded here, with extra samples only where faces meet.


SKY = NOTHING
_CHUNK = 32_768
"""Samples that are shaded together: their values stay in the processor's cache."""
_SPREAD = 1.25
"""Width of the pixel's box filter [px]: a little over one, as lens and sensor blur it."""
_LOOKS_PER_PIXEL = 4
"""Largest number of samples along the footprint of a slanted view."""
_HAZE = np.array([[205], [215], [228]], np.float32)
_HAZE_M = 260.0


@dataclass(frozen=True, eq=False)
class Renderer:
    """Renders one scene. Same input, same bytes, whatever the number of threads."""

    scene: Scene
    _views: dict[Camera, View] = field(default_factory=dict)

    def view(self, camera: Camera) -> View:
        if camera not in self._views:
            self._views[camera] = View.of(camera)
        return self._views[camera]

    def faces(self, view: View, world_from_camera: Pose, threads: int = 1) -> NDArray[np.int32]:
        """Returns (H, W) the face behind each pixel's centre, SKY where none."""
        height, width = view.rays.shape[:2]
        out = np.full((height + 2, width + 2), SKY - 1, np.int32)
        inside = out[1:-1, 1:-1]
        # Rays for every other pixel, as on a chessboard; of the rest only where its four neighbours are not one face.
        black = np.indices(inside.shape).sum(axis=0) % 2 == 0
        inside[black] = self._seen(view, black, world_from_camera, threads)
        above, below, left, right = out[:-2, 1:-1], out[2:, 1:-1], out[1:-1, :-2], out[1:-1, 2:]
        one_face = (above == below) & (left == right) & (above == left)
        np.copyto(inside, above, where=~black & one_face)
        open_ = ~black & ~one_face
        inside[open_] = self._seen(view, open_, world_from_camera, threads)
        return np.ascontiguousarray(inside)

    def _seen(self, view: View, some: NDArray[np.bool_], pose: Pose, threads: int) -> NDArray[np.int32]:
        """Returns (N,) the faces behind the centres of some (H, W) of the pixels."""
        a, b = (c[some.ravel()] for c in view.change[:2])
        return self._cast(pose, a, b, None if view.start is None else view.start[:, some.ravel()], threads)

    def depth(self, camera: Camera, world_from_camera: Pose) -> Array:
        """Returns z (H, W) [m] in the camera at each pixel's centre, inf for the sky."""
        view, scene = self.view(camera), self.scene
        faces, rays = self.faces(view, world_from_camera), view.rays
        normal = scene.axes[:, 2]
        height = ((world_from_camera.translation - scene.corner) * normal).sum(axis=1)
        slope = (normal @ world_from_camera.rotation)[faces] * np.dstack([rays, np.ones_like(rays[..., :1])])
        return np.where(faces == SKY, np.inf, -height[faces] / slope.sum(axis=-1))

    def image(
        self, camera: Camera, world_from_camera: Pose, threads: int = 1, rows: Sequence[Pose] | None = None
    ) -> NDArray[np.float32]:
        """Renders (H, W, 3) RGB, 0-255, without noise or rounding; `rows` (H,) camera_from_row of a rolling shutter."""
        view = self.view(camera) if rows is None else self.view(camera).rolled(rows)
        faces = self.faces(view, world_from_camera, threads)
        edge = edges(faces)
        a, b, ra, rb, da, db = (c[:, None] for c in view.change[:, edge.ravel()])
        x, y = ROOKS.T
        start = None if view.start is None else np.repeat(view.start[:, edge.ravel()], len(ROOKS), axis=1)
        hits = self._cast(world_from_camera, a + x * ra + y * da, b + x * rb + y * db, start, threads)
        samples = Samples.of(faces, edge, hits.reshape(-1, len(ROOKS)))
        colour = np.empty((len(samples.face), 3), np.float32)
        frame = self._frame(world_from_camera)

        def shade(some: NDArray[np.intp]) -> None:
            colour[some] = self._shade(view, world_from_camera, frame, samples, some).T

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(shade, self._split(samples)))
        return samples.mean(colour).reshape(*faces.shape, 3)

    def _split(self, samples: Samples) -> list[NDArray[np.intp]]:
        """Returns indices of samples in chunks of one look each; the sky's is the last."""
        look = np.append(self.scene.surfaces.look, np.uint8(255))[samples.face]
        order = np.argsort(look, kind="stable")
        ends = np.flatnonzero(np.diff(look[order], append=-1)) + 1
        parts = np.split(order, ends[:-1])
        return [part[a : a + _CHUNK] for part in parts for a in range(0, len(part), _CHUNK)]

    def _frame(self, pose: Pose) -> Values:
        """(12, F) of each face its axes in the camera, row by row, and where the camera is on them."""
        axes = self.scene.axes @ pose.rotation
        place = np.einsum("fij,fj->fi", self.scene.axes, pose.translation - self.scene.corner)
        return np.concatenate([axes.reshape(-1, 9), place], axis=1).T.astype(np.float32, order="C")

    def _shade(self, view: View, pose: Pose, frame: Values, samples: Samples, some: NDArray[np.intp]) -> Values:
        """Returns colours (3, n) of samples that share a look."""
        surfaces = self.scene.surfaces
        face = samples.face[some].astype(np.intp)
        a, b, ra, rb, da, db = view.change.take(samples.pixel[some], axis=1)
        dx, dy, size = samples.dx[some], samples.dy[some], np.sqrt(samples.share[some])
        a, b = a + dx * ra + dy * da, b + dx * rb + dy * db
        if face[0] == SKY:
            x, y, z = (float(r[0]) * a + float(r[1]) * b + float(r[2]) for r in pose.rotation)
            return sky(x, y, z, size * np.sqrt(np.abs(ra * db - rb * da)))
        f = frame.take(face, axis=1)
        slope = f[6] * a + f[7] * b + f[8]
        east, north = (f[0] * a + f[1] * b + f[2]) / slope, (f[3] * a + f[4] * b + f[5]) / slope
        place = f[9:]
        if view.start is not None:
            begin = view.start.take(samples.pixel[some], axis=1)
            place = place + np.einsum("ijn,jn->in", f[:9].reshape(3, 3, -1), begin)
        t = -place[2] / slope
        u, v = place[0] - place[2] * east, place[1] - place[2] * north
        scale = _SPREAD * size * t
        u1, v1 = _moved(f, east, north, scale, ra, rb)
        u2, v2 = _moved(f, east, north, scale, da, db)
        one, two = np.sqrt(u1 * u1 + v1 * v1), np.sqrt(u2 * u2 + v2 * v2)
        long, short = np.maximum(one, two), np.minimum(one, two)
        count = np.clip(np.ceil(0.5 * long / short - 0.2), 1, _LOOKS_PER_PIXEL)
        # Several samples along the longer side of the footprint, each of an equal share of its length.
        swap = one < two
        (u1, u2), (v1, v2) = _ordered(swap, u1, u2), _ordered(swap, v1, v2)
        u1, v1 = u1 / count, v1 / count
        wu, wv = np.abs(u1) + np.abs(u2), np.abs(v1) + np.abs(v2)
        wu, wv = np.maximum(wu, 0.1 * wv), np.maximum(wv, 0.1 * wu)
        more = [np.flatnonzero(count > n) for n in range(1, _LOOKS_PER_PIXEL)]
        which = np.concatenate([np.arange(len(some)), *more])
        steps = np.repeat(np.arange(_LOOKS_PER_PIXEL, dtype=np.float32), [len(some), *map(len, more)])
        steps -= (0.5 * (count - 1)).take(which)
        looks = surfaces.colour(
            int(surfaces.look[face[0]]),
            face.take(which),
            u.take(which) + steps * u1.take(which),
            v.take(which) + steps * v1.take(which),
            wu.take(which),
            wv.take(which),
        )
        colour, n = looks[:, : len(some)], len(some)
        for again in more:
            colour[:, again] += looks[:, n : n + len(again)]
            n += len(again)
        colour *= self.scene.light.take(face) / count
        return colour + (_HAZE - colour) * (1 - np.exp(t * (-1 / _HAZE_M)))

    def _cast(self, pose: Pose, a: Values, b: Values, start: Values | None, threads: int) -> NDArray[np.int32]:
        """Returns the faces (N,) that rays (a, b, 1) of the camera hit, from its centre or from `start` (3, N)."""
        directions = np.empty((a.size, 3), np.float32)
        for i, r in enumerate(pose.rotation):
            directions[:, i] = (float(r[0]) * a + float(r[1]) * b + float(r[2])).ravel()
        origin = pose.translation if start is None else pose.apply(start.T)
        return self.scene.caster.hits(origin, directions, threads) >> 1  # two triangles to a face


def _moved(f: Values, east: Values, north: Values, scale: Values, a: Values, b: Values) -> tuple[Values, Values]:
    """Returns the displacement of the point on the face as the ray changes by (a, b)."""
    down = f[6] * a + f[7] * b
    return scale * (f[0] * a + f[1] * b - east * down), scale * (f[3] * a + f[4] * b - north * down)


def _ordered(swap: NDArray[np.bool_], one: Values, two: Values) -> tuple[Values, Values]:
    """Returns both, exchanged where `swap` is True."""
    return np.where(swap, two, one), np.where(swap, one, two)


def exposed(image: NDArray[np.float32], noise_seed: int, sigma: float) -> Image:
    """Returns the uint8 image that a sensor with Gaussian noise of `sigma` [grey levels] reads out."""
    noise = np.random.Generator(np.random.SFC64(noise_seed)).standard_normal(image.shape, np.float32)
    return np.clip(image + np.float32(sigma) * noise + 0.5, 0, 255).astype(np.uint8)
