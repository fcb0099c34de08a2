"""The simulated moon: a grey, self-similar plain with craters and rocks under a low sun and a black sky."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.simulation.places.meshes import Colour, MeshPlace
from ispom.simulation.rendering.noise import grain
from ispom.simulation.rendering.scene import RayCaster

SUN = np.array([0.78, -0.5, -0.38])
"""Towards it, 30 degrees above the horizon."""
SKY = (6.0, 6.0, 8.0)
FROM_M, TO_M, HALF_M = -25.0, 150.0, 60.0
"""Extent of the plain along z, and to both sides of the route."""
FREE_M = 4.0
"""To both sides of the route there is no crater and no rock larger than a fist."""
CRATERS, ROCKS = 70, 700
_GREY, _AMBIENT = 150.0, 0.12


def build_moon(seed: int) -> MeshPlace:
    """Ground near y = 0 (y points down), passable along z."""
    rng = np.random.default_rng([seed, 7])
    ground, ground_normals = _ground(rng)
    rocks, rock_normals = _rocks(rng)
    triangles = np.concatenate([ground, rocks]).astype(np.float32)
    normals = np.concatenate([ground_normals, rock_normals]).astype(np.float32)
    return MeshPlace(triangles, _dust(normals, seed), SKY, RayCaster(triangles))


def _ground(rng: np.random.Generator) -> tuple[Array, Array]:
    """Returns triangles (T, 3, 3), and the normals at their corners."""
    near, far = np.arange(-12, 12.01, 0.2), np.arange(13, HALF_M + 1, 1.0)
    x, z = np.meshgrid(np.concatenate([-far[::-1], near, far]), np.arange(FROM_M, TO_M, 0.25))
    height = _heights(x, z, rng)
    slope_z, slope_x = np.gradient(height, z[:, 0], x[0])
    normal = np.stack([-slope_x, -np.ones_like(height), -slope_z], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    xyz = np.stack([x, -height, z], axis=-1)
    return _of_grid(xyz), _of_grid(normal)


def _of_grid(values: Array) -> Array:
    """(2 (H-1) (W-1), 3, 3) of values (H, W, 3) at the corners of cells."""
    a, b, c, d = values[:-1, :-1], values[:-1, 1:], values[1:, 1:], values[1:, :-1]
    return np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])


def _heights(x: Array, z: Array, rng: np.random.Generator) -> Array:
    """Above the plain [m]: waves, craters with rims, and hills that close the view."""
    height = np.zeros_like(x)
    for _ in range(12):
        along, phase, turn = rng.uniform(3, 14), rng.uniform(0, 2 * np.pi), rng.uniform(0, np.pi)
        height += 0.004 * along * np.sin(2 * np.pi * (np.cos(turn) * x + np.sin(turn) * z) / along + phase)
    for _ in range(CRATERS):
        radius = 0.8 * rng.pareto(1.6) + 0.8
        radius = min(radius, 14.0)
        side = rng.choice([-1, 1]) * rng.uniform(FREE_M + 1.6 * radius, HALF_M)
        away = np.hypot(x - side, z - rng.uniform(FROM_M, TO_M)) / radius
        bowl = np.where(away < 1, 0.34 * (away**2 - 1), 0.0)
        height += radius * (bowl + 0.09 * np.exp(-(((away - 1) / 0.28) ** 2)))
    beyond = np.maximum(np.abs(x) - 35, 0) / 25 + np.maximum(z - 115, 0) / 35
    return height + 8 * np.minimum(beyond, 1.2) ** 2


def _rocks(rng: np.random.Generator) -> tuple[Array, Array]:
    """Returns dented spheres, half in the ground, in the form of `_ground`."""
    directions, faces = _sphere()
    triangles, normals = [], []
    for _ in range(ROCKS):
        size = min(0.05 + 0.06 * rng.pareto(1.3), 1.4)
        nearest = 0.4 if size < 0.1 else FREE_M
        side = rng.choice([-1, 1]) * (nearest + size + rng.exponential(9))
        dents = 1 + 0.22 * np.sin(directions @ rng.normal(0, 2.2, (3, 4)) + rng.uniform(0, 6, 4)).sum(axis=1) / 2
        corners = directions * dents[:, None] * size * np.array([1, 0.7, 1])
        corners = corners + np.array([side, -0.2 * size, rng.uniform(FROM_M, TO_M)])
        flat = corners[faces]
        across = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        triangles.append(flat)
        normals.append(np.repeat(across[:, None], 3, axis=1))
    return np.concatenate(triangles), np.concatenate(normals)


def _sphere() -> tuple[Array, NDArray[np.intp]]:
    """Unit vectors (42, 3) of an icosahedron divided once, and its faces (80, 3), outward."""
    golden = (1 + 5**0.5) / 2
    corners = [(a, b * golden, 0) for a in (-1, 1) for b in (-1, 1)]
    xyz = np.array([np.roll(c, n) for n in range(3) for c in corners], float)
    edge = np.linalg.norm(xyz[:, None] - xyz[None], axis=2)
    near = np.abs(edge - 2) < 1e-9
    vertices, middles, faces = list(xyz), dict[tuple[int, int], int](), []
    triples = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]
    ]
    for triple in triples:
        i, j, k = triple if np.linalg.det(xyz[list(triple)]) > 0 else triple[::-1]
        for one, other in ((i, j), (j, k), (k, i)):
            key = (min(one, other), max(one, other))
            if key not in middles:
                middles[key] = len(vertices)
                vertices.append((xyz[one] + xyz[other]) / 2)
        ij, jk, ki = (middles[min(p), max(p)] for p in ((i, j), (j, k), (k, i)))
        faces += [(i, ij, ki), (ij, j, jk), (ki, jk, k), (ij, jk, ki)]
    directions = np.array(vertices)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), np.array(faces)


def _dust(normals: NDArray[np.float32], seed: int) -> Colour:
    sun = (SUN / np.linalg.norm(SUN)).astype(np.float32)
    number = np.random.default_rng([seed, 8]).integers(0, 2**32, dtype=np.uint32)

    def colour(triangle: NDArray[np.intp], weights: Array, xyz: Array, width_m: Array) -> Array:
        normal = np.einsum("nk,nkc->nc", weights, normals[triangle])
        light = _AMBIENT + (1 - _AMBIENT) * np.clip(normal @ sun, 0, 1) / 0.75
        x, z = (xyz[:, 0] + 0.37 * xyz[:, 1]), (xyz[:, 2] + 0.61 * xyz[:, 1])
        seeds = np.full(len(x), number, np.uint32)
        fine, stain = grain(x.astype(np.float32), z.astype(np.float32), width_m.astype(np.float32), seeds)
        grey = _GREY * light * np.maximum(1 + 0.2 * fine + 0.12 * stain, 0.15)
        return grey[:, None] * np.array([1.0, 0.98, 0.95], np.float32)

    return colour
