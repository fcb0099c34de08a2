"""A scene of textured rectangles, and ray casting by Intel's Embree: through `embreex`, else through Open3D."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, so3_exp
from ispom.simulation.rendering.materials import Material, Surfaces
from ispom.simulation.rendering.noise import Values

NOTHING = -1
"""Result for a ray that hits nothing."""
_BAND_RAYS = 60_000
"""Rays that a thread casts before it takes the next ones."""

Rays = NDArray[np.float32]
Cast = Callable[[Rays, Rays], NDArray[np.int32]]
"""Maps (N, 3) origins and (N, 3) directions to (N,) indices of triangles."""


class RayCaster:
    """Triangles, ready for rays. Safe from several threads; the same answers for any number of them."""

    def __init__(self, triangles: Rays, prepare: Callable[[Rays], Cast] | None = None) -> None:
        """Prepares triangles (T, 3, 3) [m]. Raises InputError where no library for it can be loaded."""
        self._cast = (prepare or (by_embreex if find_spec("embreex") else by_open3d))(triangles)
        # The first cast builds Embree's tree: here, before there are several threads.
        self.hits(np.zeros(3), np.ones((1, 3), np.float32))

    def hits(self, origin: Array, directions: Rays, threads: int = 1) -> NDArray[np.int32]:
        """Returns the indices (N,) of what rays from `origin` (3,) or (N, 3) [m] along `directions` (N, 3) hit, or
        NOTHING."""
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
    from ispom.io.meshes import open3d

    core, scene = open3d().core, open3d().t.geometry.RaycastingScene(nthreads=1)
    corners = np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(
        core.Tensor.from_numpy(np.ascontiguousarray(triangles.reshape(-1, 3))), core.Tensor.from_numpy(corners)
    )

    def cast(origins: Rays, directions: Rays) -> NDArray[np.int32]:
        rays = core.Tensor.from_numpy(np.concatenate([origins, directions], axis=1))
        faces = scene.cast_rays(rays, nthreads=1)["primitive_ids"]
        return faces.numpy().view(np.int32)  # what hits nothing has the largest number: -1 as a signed one

    return cast


Colour = tuple[float, float, float]
SUN = np.array([0.45, -0.75, -0.48])
"""Towards the sun, in the world (y down)."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Rectangular faces in the world (x right, y down, z along the street), ready for ray casting and shading."""

    corner: Array
    """(Q, 3) where u = v = 0 [m]."""
    axes: Array
    """(Q, 3, 3) rows: unit u, unit v, outward normal."""
    light: Values
    """(Q,) brightness from the sun and the sky."""
    surfaces: Surfaces
    caster: RayCaster
    """Face q is triangles 2q and 2q + 1."""

    @property
    def triangles(self) -> NDArray[np.float32]:
        """(2Q, 3, 3) their corners [m]."""
        return _triangles(self.corner, self.axes, np.stack(self.surfaces.size, axis=1))


@dataclass
class SceneBuilder:
    """Collects faces; `build` makes the Scene."""

    rng: np.random.Generator
    corners: list[Array] = field(default_factory=list)
    axes: list[Array] = field(default_factory=list)
    materials: list[int] = field(default_factory=list)
    parameters: list[tuple[float, ...]] = field(default_factory=list)

    def face(self, corner: Array, u: Array, v: Array, material: Material, colour: Colour, *more: float) -> None:
        """Adds a rectangle from a corner along edges u and v [m]; from outside, u points right and v up."""
        width, height = float(np.linalg.norm(u)), float(np.linalg.norm(v))
        u, v = u / width, v / height
        self.corners.append(corner)
        self.axes.append(np.stack([u, v, np.cross(u, v)]))
        self.materials.append(int(material))
        self.parameters.append((width, height, *colour, *more, *[0.0] * (3 - len(more))))

    def box(
        self,
        centre_xz: tuple[float, float],
        size: tuple[float, float, float],
        side: Material,
        colour: Colour,
        *more: float,
        bottom: float = 0.0,
        yaw_rad: float = 0.0,
        top: Material | None = None,
        top_colour: Colour | None = None,
    ) -> None:
        """Adds a box of size (x, height, z) [m] standing `bottom` above the ground, rotated about the vertical."""
        turn = so3_exp(np.array([0.0, yaw_rad, 0.0]))
        base = np.array([centre_xz[0], -bottom, centre_xz[1]])
        (sx, _, sz), up = size, np.array([0.0, -size[1], 0.0])
        ring = [(-sx / 2, -sz / 2), (sx / 2, -sz / 2), (sx / 2, sz / 2), (-sx / 2, sz / 2)]
        foot = [base + turn @ np.array([x, 0.0, z]) for x, z in ring]
        for a, b in zip(foot, foot[1:] + foot[:1], strict=True):
            self.face(a, b - a, up, side, colour, *more)
        lid = Material.PLASTER if side == Material.FACADE else side
        cap, cap_colour = lid if top is None else top, top_colour or colour
        self.face(foot[0] + up, foot[1] - foot[0], foot[3] - foot[0], cap, cap_colour)
        if bottom > 0:
            self.face(foot[3], foot[2] - foot[3], foot[0] - foot[3], lid, colour)

    def build(self) -> Scene:
        """Returns the scene with every face lit and seeded."""
        corner, axes = np.array(self.corners), np.array(self.axes)
        parameters = np.array(self.parameters)
        triangles = _triangles(corner, axes, parameters[:, :2])
        sun = np.clip(axes[:, 2] @ (SUN / np.linalg.norm(SUN)), 0, 1)
        light = 0.66 + 0.42 * sun - 0.12 * np.clip(axes[:, 2, 1], 0, 1)
        seeds = self.rng.integers(1, 2**31, len(corner))
        surfaces = Surfaces.of(np.array(self.materials), seeds, parameters)
        return Scene(corner, axes, light.astype(np.float32), surfaces, RayCaster(triangles))


def _triangles(corner: Array, axes: Array, size: Array) -> NDArray[np.float32]:
    """(2Q, 3, 3) of faces (Q) with widths and heights (Q, 2)."""
    u, v = axes[:, 0] * size[:, :1], axes[:, 1] * size[:, 1:]
    vertices = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
    return vertices[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3).astype(np.float32)
