"""Rays against plain geometry, and both libraries against each other."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.io.meshes import open3d
from ispom.simulation.rendering.scene import NOTHING, RayCaster, by_open3d

RNG = np.random.default_rng(3)
TRIANGLES = (RNG.normal(0, 10, (400, 1, 3)) + RNG.normal(0, 2, (400, 3, 3))).astype(np.float32)
ORIGIN = np.array([0.3, -0.2, 0.1])
DIRECTIONS = RNG.normal(0, 1, (130_000, 3)).astype(np.float32)


def nearest(origin: np.ndarray, directions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(N,) first triangles by solving origin + t d = a + u (b - a) + v (c - a) for each of them."""
    a, b, c = np.moveaxis(triangles.astype(float), 1, 0)
    columns = np.stack(np.broadcast_arrays(-directions[:, None], (b - a)[None], (c - a)[None]), axis=-1)
    t, u, v = np.moveaxis(np.linalg.solve(columns, (origin - a)[None, ..., None])[..., 0], -1, 0)
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    return np.where(np.isfinite(t.min(axis=1)), t.argmin(axis=1), NOTHING)


def test_rays_hit_what_geometry_says() -> None:
    some = DIRECTIONS[:500]
    hits = RayCaster(TRIANGLES).hits(ORIGIN, some)
    assert (hits == nearest(ORIGIN, some.astype(float), TRIANGLES)).mean() > 0.995  # edges may fall to either side
    assert 0.1 < (hits == NOTHING).mean() < 0.9


def test_each_ray_may_have_an_origin_of_its_own() -> None:
    some, caster = DIRECTIONS[:70_000], RayCaster(TRIANGLES)
    origins = np.where(np.arange(len(some))[:, None] % 2, ORIGIN, -ORIGIN)
    expected = np.where(np.arange(len(some)) % 2, caster.hits(ORIGIN, some), caster.hits(-ORIGIN, some))
    assert np.array_equal(caster.hits(origins, some), expected)


def test_the_number_of_threads_changes_nothing() -> None:
    caster = RayCaster(TRIANGLES)
    one = caster.hits(ORIGIN, DIRECTIONS)
    assert all(np.array_equal(one, caster.hits(ORIGIN, DIRECTIONS, threads)) for threads in (2, 5))


def test_no_rays_hit_nothing() -> None:
    assert not len(RayCaster(TRIANGLES).hits(ORIGIN, DIRECTIONS[:0]))


def test_both_libraries_give_the_same_answers() -> None:
    try:
        open3d()
    except InputError as error:
        pytest.skip(str(error))
    assert np.array_equal(
        RayCaster(TRIANGLES, by_open3d).hits(ORIGIN, DIRECTIONS), RayCaster(TRIANGLES).hits(ORIGIN, DIRECTIONS)
    )


def test_the_simulation_does_without_open3d() -> None:
    """Its wheel loads libraries of the system that a bare machine lacks."""
    script = (
        "import sys; sys.modules['open3d'] = None\n"
        "from ispom.simulation.source import Source\n"
        "assert Source(0, False, 0.1).render(0, 'video', 1).std() > 10\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
