"""Left and right images that are exchanged, on images that have texture at known places alone."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.types import Camera, Decision, Frame, Image, Rig, Status

WIDTH, HEIGHT, APART_PX, PATCH_PX, DISPARITY_PX = 640, 480, 60, 13, 12
RIG = Rig.stereo(Camera(WIDTH, HEIGHT, 400.0, 400.0, 319.5, 239.5), 0.4)


def patches(shift_px: int) -> tuple[Image, int]:
    """Patches of noise on a grey wall, moved to the left, and how many they are. No other place can be found again."""
    rng, count = np.random.default_rng(5), 0
    image = np.full((HEIGHT, WIDTH), 128, np.uint8)
    for y in range(APART_PX // 2, HEIGHT - APART_PX // 2, APART_PX):
        for x in range(APART_PX, WIDTH - APART_PX, APART_PX):
            noise = rng.integers(0, 256, (PATCH_PX, PATCH_PX), np.uint8)
            image[y : y + PATCH_PX, x - shift_px : x - shift_px + PATCH_PX] = noise
            count += 1
    return image, count


def exchanged(left: Image, right: Image) -> tuple[Decision | None, Status]:
    estimator = ModernStereoConfig().build(RIG)
    _, step = estimator.step(estimator.start(), Frame.stereo(0, left, right))
    return next((d for d in step.decisions if d.key == "images_exchanged"), None), step.status


def test_each_place_is_found_again_behind_the_rig() -> None:
    (left, count), (right, _) = patches(0), patches(DISPARITY_PX)
    found, status = exchanged(right, left)
    assert found is not None and not found.passed and status is Status.INITIALISING
    assert found.value >= 0.9 * count, "all but a few of the patches"


def test_images_that_are_not_exchanged_are_not_said_to_be() -> None:
    found, _ = exchanged(patches(0)[0], patches(DISPARITY_PX)[0])
    assert found is None
