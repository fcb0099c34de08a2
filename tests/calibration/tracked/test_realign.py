"""Places found again from the first sight of each corner."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from ispom.calibration.tracked.realign import realign
from ispom.calibration.tracked.scene import Scene
from ispom.calibration.tracked.tracks import Tracks

SIZE, FOCAL = (400, 300), 300.0
NEARER = 0.7
"""The second image is taken at so much of the first one's distance from a wall."""


def wall() -> tuple[Tracks, Scene, np.ndarray]:
    """Corners on a wall seen from afar and from near, where they were followed with errors; and their true places."""
    rng = np.random.default_rng(0)
    grain = rng.integers(0, 255, (75, 100)).astype(np.uint8)
    first = cv2.resize(grain, SIZE, interpolation=cv2.INTER_CUBIC)
    middle = (np.array(SIZE) - 1) / 2
    scale = np.eye(2) / NEARER
    second = cv2.warpAffine(first, np.column_stack([scale, middle - scale @ middle]), SIZE, flags=cv2.INTER_CUBIC)
    uv = middle + rng.uniform(-90, 90, (60, 2))
    rays = np.column_stack([(uv - middle) / FOCAL, np.ones(60)])
    points = np.column_stack([2 * rays, np.ones(60)])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    lens = np.array([np.log(FOCAL), *middle, 0.0, 0.0])
    scene = Scene(lens, np.tile(np.eye(3), (2, 1, 1)), np.array([[0, 0, 0], [0, 0, 2 * (NEARER - 1)]]), points)
    true = middle + (uv - middle) / NEARER
    places = np.stack([uv, true + rng.normal(0, 0.4, (60, 2))], axis=1).reshape(-1, 2)
    view, point = np.tile([0, 1], 60), np.repeat(np.arange(60), 2)
    images = np.asarray(first, np.uint8), np.asarray(second, np.uint8)
    return Tracks(SIZE, 1.0, np.arange(2), view, point, places, images), scene, true


def test_corners_are_found_again_where_the_scene_came_nearer() -> None:
    tracks, scene, true = wall()
    found = realign(tracks, scene)
    again = found.view == 1
    assert again.sum() >= 50 and (found.uv[found.view == 0] == tracks.uv[tracks.view == 0]).all()
    assert np.median(np.linalg.norm(found.uv[again] - true[found.point[again]], axis=1)) < 0.05


def test_a_corner_that_looks_like_another_one_is_gone() -> None:
    tracks, scene, _ = wall()
    swapped = tracks.uv.copy()
    swapped[1::2] = np.roll(tracks.uv[1::2], 1, axis=0)
    found = realign(replace(tracks, uv=swapped), scene)
    assert (found.view == 1).sum() <= 5 and (found.view == 0).sum() == 60


def test_tracks_without_images_stay() -> None:
    tracks, scene, _ = wall()
    bare = replace(tracks, images=())
    assert realign(bare, scene) is bare
