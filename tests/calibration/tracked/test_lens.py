"""A lens from tracks alone: what it finds, how sure it says that it is, and what no motion tells."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.calibration.tracked.scene import LensPrior, Scene, scene_problem
from ispom.calibration.tracked.solve import TrackedLens, lens_of_tracks, sandwich_covariance
from ispom.calibration.tracked.tracks import Tracks, key_tracks
from ispom.solvers.least_squares import cost, normal_equations
from ispom.types import Camera
from tests.calibration.tracked.scenes import LENS, straight, tracks, turning

SIGMA = 0.3
TRUTH = np.array([np.log(LENS.fx), LENS.cx, LENS.cy, LENS.distortion[0], LENS.distortion[1]])
SEEDS = 20


def guess(wrong: float = 1.3) -> Camera:
    focal = wrong * LENS.fx
    return Camera(LENS.width, LENS.height, focal, focal, (LENS.width - 1) / 2, (LENS.height - 1) / 2)


def solved(seen: Tracks, wrong: float = 1.3) -> TrackedLens:
    found = lens_of_tracks(seen, guess(wrong), SIGMA)
    assert found is not None
    return found


def values(found: TrackedLens) -> np.ndarray:
    camera = found.camera
    return np.array([np.log(camera.fx), camera.cx, camera.cy, *camera.distortion[:2]])


@pytest.mark.parametrize("wrong", [0.75, 1.0, 1.35])
def test_a_lens_is_found_from_exact_tracks(wrong: float) -> None:
    found = solved(tracks(0, noise_px=0.0), wrong)
    assert (np.abs(values(found) - TRUTH) < [1e-3, 0.3, 0.3, 5e-3, 5e-3]).all()


def test_noisy_tracks_are_within_three_standard_errors_in_95_percent_of_seeds() -> None:
    found = [solved(tracks(seed, views=10, points=150)) for seed in range(SEEDS)]
    shares = np.array([(values(each) - TRUTH) / each.sigma for each in found])
    assert (np.abs(shares) <= 3).mean(0).min() >= 0.95
    assert np.sqrt((shares**2).mean(0)).max() < 1.5
    assert max(each.sigma[0] for each in found) < 0.02
    assert np.abs(np.array([values(each)[0] for each in found]) - TRUTH[0]).max() < 0.03


def test_tracks_that_are_wrong_are_left_out() -> None:
    found = solved(tracks(1, wrong=0.05))
    assert found.camera.fx == pytest.approx(LENS.fx, rel=0.02)
    assert found.rms_px < 1.0


def test_a_thing_that_moves_is_left_out() -> None:
    found = solved(tracks(1, noise_px=0.05, moving=0.3))
    assert (np.abs(values(found) - TRUTH) < [5e-3, 2, 2, 0.01, 0.01]).all()


def test_a_camera_on_a_tripod_tells_its_lens_by_its_turns() -> None:
    found = solved(tracks(2, turning))
    assert found.camera.fx == pytest.approx(LENS.fx, rel=0.02)
    assert found.sigma[0] < 0.02


def test_a_straight_way_without_turns_leaves_the_focal_length_open() -> None:
    found = solved(tracks(3, straight))
    assert found.sigma[0] > 0.5 * SIGMA


def test_views_after_a_jump_are_left_out() -> None:
    whole = tracks(0, noise_px=0.0)
    for end in (4, 10):
        late = whole.view >= end
        other = replace(whole, point=np.where(late, whole.point + whole.points, whole.point))
        order = np.lexsort((other.view, other.point))
        jumped = replace(other, point=other.point[order], view=other.view[order], uv=other.uv[order])
        assert len(jumped.joined().views) == end
        found = lens_of_tracks(jumped, guess(), SIGMA)
        assert (found is None) == (end < 5)
        assert found is None or (np.abs(values(found) - TRUTH) < [1e-3, 0.3, 0.3, 5e-3, 5e-3]).all()


def test_halves_of_the_images_that_differ_make_it_less_sure() -> None:
    still, zoomed = solved(tracks(4)), solved(tracks(4, zoom=0.03))
    assert still.sigma[0] < 0.003
    assert zoomed.sigma[0] > 3 * still.sigma[0]


def test_too_few_views_and_no_motion_say_nothing() -> None:
    assert lens_of_tracks(tracks(0, views=4), guess(), SIGMA) is None
    still = key_tracks([np.full((100, 160), 90, np.uint8)] * 5, 10)
    assert lens_of_tracks(still, guess(), SIGMA) is None


def test_derivatives_are_those_of_the_cost() -> None:
    rng = np.random.default_rng(0)
    seen = tracks(0, views=5, points=40)
    points = rng.normal(0, 1, (seen.points, 4)) * (1, 1, 0.2, 0.1) + (0, 0, 2, 0.3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    lens = np.array([np.log(400.0), 370.0, 240.0, -0.1, 0.02])
    scene = Scene(lens, np.tile(np.eye(3), (5, 1, 1)), 0.1 * rng.normal(0, 1, (5, 3)), points)
    prior = LensPrior(lens + 0.01, np.array([0.3, 10, 10, 0.2, 0.1]))
    problem = scene_problem(scene, seen.observations, prior, 50.0)
    equations = normal_equations(problem, scene)
    for i, step in enumerate((1e-6, 1e-3, 1e-3, 1e-6, 1e-6)):
        ends = []
        for sign in (1, -1):
            moved = lens.copy()
            moved[i] += sign * step
            ends.append(cost(problem, replace(scene, lens=moved)))
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(equations.shared_gradient[i], rel=1e-4)


def test_points_whose_distance_no_image_tells_leave_the_lens_a_covariance() -> None:
    """Of a scene whose camera only turns, as one of images in a wrong order may be."""
    seen = tracks(2, turning, noise_px=0.5)
    poses = [turning(v / (len(seen.views) - 1)).inverse() for v in range(len(seen.views))]
    rays = np.random.default_rng(0).normal(0, 1, (seen.points, 4))
    for m, v, uv in zip(seen.point, seen.view, seen.uv, strict=True):
        x = np.append((uv - TRUTH[1:3]) / LENS.fx, 1.0)
        rays[m, :3] = poses[v].rotation.T @ x
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rotations = np.array([pose.rotation for pose in poses])
    scene = Scene(TRUTH.copy(), rotations, np.zeros((len(poses), 3)), rays)
    prior = LensPrior(TRUTH, np.array([SIGMA, 10.0, 10.0, 0.3, 0.1]))
    covariance = sandwich_covariance(scene, seen.observations, prior, np.ones(len(seen.uv)))
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert covariance[0, 0] < SIGMA**2


def test_letters_on_the_images_are_no_part_of_the_scene() -> None:
    """A clock on a dashcam's film made its focal length 4 % wrong, and its distortion by 48 standard errors."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(0, 256, (240, 900), np.uint8), (0, 0), 2)
    letters = cv2.GaussianBlur(rng.integers(0, 256, (40, 120), np.uint8), (0, 0), 1.5)
    images = []
    for i in range(12):
        image = ground[:, 30 * i : 30 * i + 320].copy()
        image[190:230, 20:140] = letters
        images.append(np.asarray(image, np.uint8))
    found = key_tracks(images, 12)
    often = np.bincount(found.point) >= 3
    on_letters = ((found.uv > (26, 196)) & (found.uv < (134, 224))).all(1)
    assert often.sum() > 100 and not (on_letters & often[found.point]).any()
