"""Points where given poses and observations put them."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, Pose
from ispom.solvers.multiview.structure import intersected
from ispom.types import Camera, Trajectory

CAMERA = Camera(640, 480, 500.0, 505.0, 319.5, 239.5, (-0.2, 0.05, 0.001, -0.001))
RECTIFIED = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)


def views(count: int) -> Trajectory:
    turn = [Pose.from_rotvec(np.array([0.01, -0.02, 0.005]) * i, np.array([0.4, 0.05, 0.1]) * i) for i in range(count)]
    return Trajectory.of([(10**8 * i, pose) for i, pose in enumerate(turn)], "video")


def seen(keys: Trajectory, camera: Camera, xyz: Array) -> tuple:
    uv = np.concatenate([camera.project(pose.inverse().apply(xyz)) for _, pose in keys.items()])
    frames, ids = np.repeat(np.arange(len(keys)), len(xyz)), np.tile(np.arange(len(xyz)) * 7, len(keys))
    return frames, ids, uv, np.full(len(uv), np.nan)


def cloud(count: int = 80) -> Array:
    return np.random.default_rng(0).uniform((-3, -2, 6), (3, 2, 14), (count, 3))


def test_exact_observations_give_the_exact_points() -> None:
    xyz = cloud()
    ids, found = intersected(views(6), CAMERA, *seen(views(6), CAMERA, xyz))
    assert ids.tolist() == (np.arange(80) * 7).tolist()
    np.testing.assert_allclose(found, xyz, atol=1e-5)


def test_the_order_of_observations_is_free_and_a_wrong_one_counts_little() -> None:
    xyz, (frames, ids, uv, nan) = cloud(), seen(views(8), CAMERA, cloud())
    uv[-80:] += 40
    mixed = np.random.default_rng(1).permutation(len(ids))
    order, found = intersected(views(8), CAMERA, frames[mixed], ids[mixed], uv[mixed], nan)
    assert order.tolist() == (np.arange(80) * 7).tolist()
    np.testing.assert_allclose(found, xyz, rtol=0.02, atol=0.02)


def test_one_pair_is_enough_where_its_disparity_is_known() -> None:
    xyz, baseline_m = cloud(), 0.5
    frames, ids, uv, nan = seen(views(1), RECTIFIED, xyz)
    assert not len(intersected(views(1), RECTIFIED, frames, ids, uv, nan)[0])
    disparity_px = RECTIFIED.fx * baseline_m / xyz[:, 2]
    found = intersected(views(1), RECTIFIED, frames, ids, uv, disparity_px, baseline_m)
    assert len(found[0]) == 80
    np.testing.assert_allclose(found[1], xyz, atol=1e-6)


def test_points_too_far_for_their_parallax_are_absent() -> None:
    xyz = cloud()
    xyz[::2, 2] += 1e5
    ids, found = intersected(views(6), CAMERA, *seen(views(6), CAMERA, xyz))
    assert ids.tolist() == (np.arange(1, 80, 2) * 7).tolist()
    np.testing.assert_allclose(found, xyz[1::2], atol=1e-4)
