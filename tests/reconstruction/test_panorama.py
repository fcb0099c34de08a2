"""Panoramas from images of a sphere whose grey level is known at each direction."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array, so3_exp
from ispom.reconstruction.panorama import equirectangular, spaced
from ispom.types import Camera, Image

CAMERA = Camera(160, 120, 100.0, 100.0, 79.5, 59.5, (-0.1, 0.02, 0.0, 0.0))
WIDTH_PX = 512


def grey(directions: Array) -> Array:
    """Returns 60 to 196 by direction (..., 3), smooth."""
    return 128 + 34 * np.sin(3 * directions[..., 0] + 1) + 34 * np.cos(4 * directions[..., 2] + directions[..., 1])


def seen(rotation: Array) -> Image:
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays, _ = CAMERA.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    return np.rint(grey(rays @ rotation.T)).astype(np.uint8).reshape(CAMERA.height, CAMERA.width)


def turn(yaw_deg: float, pitch_deg: float = 0.0) -> Array:
    return so3_exp(np.radians([0.0, yaw_deg, 0.0])) @ so3_exp(np.radians([pitch_deg, 0.0, 0.0]))


def test_a_full_turn_shows_each_direction_at_its_place() -> None:
    rotations = [turn(yaw, 5 * np.sin(yaw)) for yaw in range(0, 360, 30)]
    panorama = equirectangular([(seen(r), r) for r in rotations], CAMERA, WIDTH_PX)
    height, width = panorama.shape[:2]
    assert width == WIDTH_PX and 60 < height < 120
    middle = panorama[height // 2].astype(float)
    longitude = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi
    # The crop is not symmetric: the row of the horizon is the one that fits best.
    rows = panorama[..., 0].astype(float)
    horizon = grey(np.stack([np.sin(longitude), np.zeros(width), np.cos(longitude)], axis=1))
    difference = np.abs(rows - horizon).max(axis=1)
    assert difference.min() < 2.0 and abs(int(difference.argmin()) - height // 2) < 8
    assert (middle > 0).all()


def test_one_image_is_cropped_to_what_it_shows() -> None:
    panorama = equirectangular([(seen(turn(0)), turn(0))], CAMERA, WIDTH_PX)
    height, width = panorama.shape[:2]
    assert 100 < width < 140 and 80 < height < 110
    centre = panorama[height // 2, width // 2, 0]
    assert abs(float(centre) - float(grey(np.array([0.0, 0.0, 1.0])))) < 3


def test_nothing_gives_nothing() -> None:
    assert equirectangular([], CAMERA, WIDTH_PX).shape == (0, 0, 3)


def test_orientations_are_spaced_and_no_more_than_asked_for() -> None:
    rotations = np.stack([turn(yaw) for yaw in range(60)])
    assert spaced(rotations, np.radians(9.99), 100).tolist() == [0, 10, 20, 30, 40, 50]
    assert spaced(rotations, np.radians(9.99), 3).tolist() == [0, 10, 20]
