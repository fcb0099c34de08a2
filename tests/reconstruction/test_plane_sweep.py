"""Dense depth of rendered video images of known pose against the renderer's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.reconstruction.plane_sweep import PlaneSweep, Undistortion
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Flight
from ispom.simulation.places.city import build_city
from ispom.simulation.rendering.renderer import Renderer, exposed
from ispom.types import Image

RIG = simulated_rig(0.5)
CAMERA = replace(RIG.camera("video"), distortion=())
BEGIN_NS, STEP_NS = 9_000_000_000, 100_000_000


@pytest.fixture(scope="module")
def seen() -> tuple[list[Image], list[Pose], np.ndarray]:
    """Images, their poses, and the depth of the one in the middle."""
    renderer, path = Renderer(build_city(0)), Flight.seeded(0)
    poses = [path.pose_at(BEGIN_NS + k * STEP_NS) @ RIG.rig_from_video for k in (-2, -1, 0, 1, 2)]
    images = [exposed(renderer.image(CAMERA, pose, 2), n, 1.6) for n, pose in enumerate(poses)]
    return images, poses, renderer.depth(CAMERA, poses[2])


def test_depth_is_that_of_the_place(seen: tuple[list[Image], list[Pose], np.ndarray]) -> None:
    images, poses, true = seen
    others = [(images[k], poses[k].inverse() @ poses[2]) for k in (0, 1, 3, 4)]
    found = PlaneSweep().depth(images[2], others, CAMERA, 1.2, 10.0)
    known = found > 0
    error = np.abs(found[known] / true[known] - 1)
    assert known[true < 9.5].mean() > 0.3
    assert np.median(error) < 0.015 and np.percentile(error, 90) < 0.05


def test_without_motion_nothing_is_known(seen: tuple[list[Image], list[Pose], np.ndarray]) -> None:
    images, _, _ = seen
    found = PlaneSweep().depth(images[2], [(images[2], Pose())] * 2, CAMERA, 1.2, 10.0)
    assert not found.any()


def test_an_undistorted_image_is_that_of_the_ideal_camera() -> None:
    real = RIG.camera("video")
    renderer, pose = Renderer(build_city(0)), Flight.seeded(0).pose_at(BEGIN_NS) @ RIG.rig_from_video
    bent, straight = (exposed(renderer.image(c, pose, 2), 0, 0.0) for c in (real, CAMERA))
    undistortion = Undistortion.of(real)
    found = undistortion.image(bent)
    assert undistortion.ideal == CAMERA
    inside = (slice(20, -20), slice(20, -20))
    assert np.median(np.abs(found[inside].astype(int) - straight[inside].astype(int))) <= 2
