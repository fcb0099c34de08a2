"""The renderer against geometry and against itself: what it draws is where it says, and moves as it should."""

from functools import cache

import cv2
import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Flight
from ispom.simulation.places.city import build_city
from ispom.simulation.rendering.renderer import Renderer, exposed

RIG = simulated_rig(0.5)
PATH = Flight.seeded(0)
T_NS = 9_000_000_000


@cache
def renderer() -> Renderer:
    return Renderer(build_city(0))


def world_from(camera: str, time_ns: int = T_NS) -> Pose:
    return PATH.pose_at(time_ns) @ RIG.rig_from(camera)  # type: ignore[arg-type]


def points_in_world(camera: str, uv: np.ndarray, time_ns: int = T_NS) -> np.ndarray:
    """What the whole pixels uv (N, 2) of a camera see; NaN for the sky."""
    cam, pose = RIG.camera(camera), world_from(camera, time_ns)  # type: ignore[arg-type]
    z = renderer().depth(cam, pose)[uv[:, 1], uv[:, 0]]
    z = np.where(np.isfinite(z), z, np.nan)
    return pose.apply(np.column_stack([cam.normalise(uv), np.ones(len(uv))]) * z[:, None])


def test_images_do_not_depend_on_the_number_of_threads() -> None:
    one = renderer().image(RIG.left, world_from("left"), threads=1)
    three = renderer().image(RIG.left, world_from("left"), threads=3)
    assert one.tobytes() == three.tobytes()


@pytest.mark.parametrize("camera", ["video", "left"])
def test_a_point_seen_in_a_pixel_projects_into_it(camera: str) -> None:
    cam, pose = RIG.camera(camera), world_from(camera)  # type: ignore[arg-type]
    uv = np.stack(np.meshgrid(np.arange(0, cam.width, 7), np.arange(0, cam.height, 7)), axis=-1).reshape(-1, 2)
    xyz = points_in_world(camera, uv)
    seen = np.isfinite(xyz).all(axis=1)
    assert seen.mean() > 0.6
    assert np.abs(cam.project(pose.inverse().apply(xyz[seen])) - uv[seen]).max() < 1e-3


def test_stereo_rows_align_and_disparity_is_that_of_the_depth() -> None:
    left = exposed(renderer().image(RIG.left, world_from("left"), 2), 1, 1.6)
    right = exposed(renderer().image(RIG.right, world_from("right"), 2), 2, 1.6)
    uv, found, smooth = tracked(left, right, renderer().depth(RIG.left, world_from("left")))
    z = renderer().depth(RIG.left, world_from("left"))[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    expected = RIG.left.fx * RIG.baseline_m / z
    assert smooth.sum() > 150
    assert np.median(np.abs((found - uv)[smooth, 1])) < 0.1
    assert np.median(np.abs((uv - found)[smooth, 0] - expected[smooth])) < 0.15


def test_tracked_motion_is_the_true_motion() -> None:
    """Aliasing or flicker would pull the tracks off."""
    later = T_NS + 33_333_333
    first = exposed(renderer().image(RIG.video, world_from("video"), 2), 1, 1.6)
    second = exposed(renderer().image(RIG.video, world_from("video", later), 2), 2, 1.6)
    uv, found, smooth = tracked(first, second, renderer().depth(RIG.video, world_from("video")))
    xyz = points_in_world("video", uv.astype(int))
    expected = RIG.video.project(world_from("video", later).inverse().apply(xyz))
    assert smooth.sum() > 150
    assert np.median(np.linalg.norm(found - expected, axis=1)[smooth]) < 0.1


def test_corners_everywhere_on_the_ground_too() -> None:
    grey = cv2.cvtColor(exposed(renderer().image(RIG.video, world_from("video"), 2), 1, 1.6), cv2.COLOR_RGB2GRAY)
    corners = cv2.goodFeaturesToTrack(grey, 400, 0.005, 5).reshape(-1, 2)
    xyz = points_in_world("video", corners.astype(int))
    assert (np.abs(xyz[:, 1]) < 0.2).sum() > 40
    assert np.isfinite(xyz).all(axis=1).sum() > 300


def test_depth_is_mixed_and_the_path_stays_in_free_space() -> None:
    coarse = simulated_rig(0.05)
    for seed in (0, 1, 2):
        scene, path = Renderer(build_city(seed)), Flight.seeded(seed)
        for time_ns in range(0, 20_000_000_001, 1_000_000_000):
            for name in ("video", "left", "right"):
                z = scene.depth(coarse.camera(name), path.pose_at(time_ns) @ coarse.rig_from(name))  # type: ignore[arg-type]
                assert z.min() > 0.9
                near, far = np.percentile(z[np.isfinite(z)], [10, 95])
                assert near > 1.5
                assert far > 12
                assert far > 2.5 * near


def test_seeds_change_the_place() -> None:
    a, b = build_city(0), build_city(1)
    assert a.corner.shape != b.corner.shape or not np.allclose(a.corner, b.corner)


def tracked(first: np.ndarray, second: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whole pixels (N, 2) of corners, where KLT finds them again, and which are tracked and away from depth steps."""
    a, b = (cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in (first, second))
    uv = np.round(cv2.goodFeaturesToTrack(a, 600, 0.005, 5).reshape(-1, 2)).astype(np.float32)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.01)
    found, ok, _ = cv2.calcOpticalFlowPyrLK(a, b, uv, None, winSize=(11, 11), maxLevel=4, criteria=criteria)
    back, _, _ = cv2.calcOpticalFlowPyrLK(b, a, found, None, winSize=(11, 11), maxLevel=4, criteria=criteria)
    nearness = (1 / depth).astype(np.float32)
    step = cv2.dilate(nearness, np.ones((11, 11))) - 1.25 * cv2.erode(nearness, np.ones((11, 11)))
    x, y = uv.astype(int).T
    good = (ok.ravel() > 0) & (np.linalg.norm(back - uv, axis=1) < 0.5) & (step[y, x] < 0) & (nearness[y, x] > 0)
    return uv, found, good
