"""Depth images of a known place become its surface."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.meshes import open3d
from ispom.reconstruction.fusion import Fusion, FusionSettings
from ispom.reconstruction.model import Surface, simplified
from ispom.types import Camera

CAMERA = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)
WALL_M = 3.0


@pytest.fixture(autouse=True)
def _needs_open3d() -> None:
    try:
        open3d()
    except InputError as error:
        pytest.skip(str(error))


def of_a_wall(noise_m: float = 0.0) -> Fusion:
    """The plane z = 3, left half red and right half green, from five places."""
    fusion, rng = Fusion(FusionSettings(0.05, min_triangles=50)), np.random.default_rng(0)
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    rays = np.dstack([CAMERA.normalise(np.column_stack([u.ravel(), v.ravel()])).reshape(120, 160, 2), np.ones_like(u)])
    for n in range(5):
        pose = Pose.from_rotvec(np.array([0.02 * n, -0.05 * n, 0.1]), np.array([0.2 * n, 0.1, 0.1 * n]))
        depth = (WALL_M - pose.translation[2]) / (rays @ pose.rotation[2])
        world = pose.apply(rays * depth[..., None])
        image = np.where(world[..., :1] < 0, np.uint8([220, 30, 20]), np.uint8([30, 200, 20]))
        noisy = depth + noise_m * rng.standard_normal(depth.shape)
        fusion.add(noisy.astype(np.float32), image, CAMERA, pose, 10.0)
    return fusion


def test_a_wall_is_where_it_is_in_its_colours() -> None:
    mesh = of_a_wall().mesh()
    xyz, rgb = mesh.points.xyz, mesh.points.rgb
    assert np.abs(xyz[:, 2] - WALL_M).max() < 0.004
    assert np.ptp(xyz[:, 0]) > 2 and np.ptp(xyz[:, 1]) > 1.5
    assert (mesh.points.normals @ [0, 0, -1] > 0.99).all(), "they point to where the wall was seen from"
    assert np.abs(rgb[xyz[:, 0] < -0.1].astype(int) - [220, 30, 20]).max() <= 2
    assert np.abs(rgb[xyz[:, 0] > 0.1].astype(int) - [30, 200, 20]).max() <= 2


def test_the_same_looks_give_the_same_bytes() -> None:
    one, other = of_a_wall(0.01), of_a_wall(0.01)
    for a, b in ((one.mesh(), other.mesh()),):
        assert a.points.xyz.tobytes() == b.points.xyz.tobytes() and a.triangles.tobytes() == b.triangles.tobytes()
    assert one.cloud().xyz.tobytes() == other.cloud().xyz.tobytes()


def test_a_smaller_mesh_is_the_same_surface() -> None:
    small = simplified(of_a_wall().mesh(), 300)
    assert 100 < len(small) <= 310 and np.abs(small.points.xyz[:, 2] - WALL_M).max() < 0.01


def test_a_place_too_large_for_its_voxels_is_a_sentence() -> None:
    fusion = Fusion(FusionSettings(0.01, max_gb=0.001))
    with pytest.raises(InputError, match=r"--voxel-m, such as 0\.015"):
        for _ in range(2):
            fusion.add(np.full((120, 160), 2, np.float32), np.zeros((120, 160), np.uint8), CAMERA, Pose(), 10.0)


def test_nothing_seen_is_a_sentence() -> None:
    with pytest.raises(InputError, match="no surface"):
        Fusion(FusionSettings(0.05)).mesh()


def test_distances_to_a_surface() -> None:
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], np.float32)
    queries = np.array([[0.2, 0.2, 0.5], [-3, 0, 4], [0.1, 0.1, 0]])
    np.testing.assert_allclose(Surface(triangle).distances(queries), [0.5, 5, 0], atol=1e-6)
