"""Suspects that images and times show, on images made for it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ispom.evaluation.doctor.examination import Examination, examination
from ispom.evaluation.doctor.stretch import Shot
from ispom.evaluation.doctor.suspects.cover import covered
from ispom.evaluation.doctor.suspects.images import blur, darkness, edge_width_px, exposure_jumps, haze, low_texture
from ispom.evaluation.doctor.suspects.lens import fixed_edges, on_lens
from ispom.evaluation.doctor.suspects.smear import gains
from ispom.evaluation.doctor.suspects.times import dropped, repeated
from ispom.sequences import open_sequence
from ispom.types import Camera, Image, Rig

FRAME_NS = 33_000_000
CAMERA = Camera(320, 240, 250.0, 250.0, 159.5, 119.5)


def picture(seed: int) -> Image:
    """Rectangles of all brightnesses, with the noise of a sensor."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 320), 120, np.uint8)
    for _ in range(150):
        x, y, w, h = rng.integers(0, (320, 240, 60, 60))
        cv2.rectangle(image, (int(x), int(y)), (int(x + w + 5), int(y + h + 5)), int(rng.integers(30, 220)), -1)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0, 1.6, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def seen(images: list[Image], times_ns: np.ndarray | None = None) -> Examination:
    times_ns = np.arange(len(images)) * FRAME_NS if times_ns is None else times_ns
    shots = tuple(Shot(i, int(t), {"video": image}) for i, (t, image) in enumerate(zip(times_ns, images, strict=True)))
    return Examination(Rig.single(CAMERA), shots, times_ns)


WIDE = np.hstack([picture(seed) for seed in range(2)])
GOOD = [np.ascontiguousarray(WIDE[:, 4 * i : 4 * i + 320]) for i in range(10)]
"""The camera turns to the right."""
LONG = [np.ascontiguousarray(WIDE[:, 8 * i : 8 * i + 320]) for i in range(40)]
"""It turns farther."""


@pytest.mark.parametrize("suspect", [darkness, covered, blur, haze, low_texture, exposure_jumps, dropped, repeated])
def test_good_images_have_no_cause(suspect) -> None:
    finding = suspect(seen(GOOD))
    assert finding is not None and not finding.found


def test_darkness() -> None:
    finding = darkness(seen([(0.1 * image.astype(float)).astype(np.uint8) for image in GOOD]))
    assert finding is not None and finding.found


def test_a_black_sky_is_no_lack_of_light() -> None:
    images = [image.copy() for image in LONG]
    for image in images:
        image[:190] = 3
    finding = darkness(seen(images))
    assert np.mean(images) < 36 and finding is not None and not finding.found


def with_dark(images: list[Image], rows: int = 240, columns: int = 80) -> list[Image]:
    """Returns the images with a dark part at the left, or at the top."""
    dark = [image.copy() for image in images]
    for image in dark:
        image[:rows, :columns] = 10
    return dark


def test_a_covered_quarter_has_its_share() -> None:
    finding = covered(seen(with_dark(LONG)))
    assert finding is not None and finding.found and finding.values["covered_share"] == pytest.approx(0.25)


def test_a_dark_sky_along_which_the_scene_passes_is_not_called_a_cover() -> None:
    assert covered(seen(with_dark(LONG, 80, 320))) is None


def test_a_cover_out_of_which_the_scene_moves_is_known_by_its_edge() -> None:
    finding = covered(seen(with_dark(LONG[::-1])))
    assert finding is not None and finding.found


def test_of_a_camera_at_rest_it_is_not_known_whether_it_is_covered() -> None:
    assert covered(seen(with_dark(GOOD[:1] * 10))) is None


def test_the_bars_of_a_film_cover_nothing() -> None:
    images = with_dark(LONG, 40, 320)
    for image in images:
        image[-40:] = 10
    finding = covered(seen(images))
    assert finding is not None and not finding.found


def test_the_black_sky_of_the_moon_covers_nothing() -> None:
    finding = covered(examination(open_sequence("sim:tiny?place=moon&motion=drive", seed=0), 0, 20))
    assert finding is not None and not finding.found


def test_a_cover_is_told_by_another_camera_that_sees_light_there() -> None:
    finding = covered(examination(open_sequence("sim:tiny?fault=blocked:share=0.5", seed=0), 0, 20))
    assert finding is not None and finding.found


@pytest.mark.parametrize("sigma", [2.0, 3.0])
def test_the_width_of_an_edge_is_that_of_the_blur(sigma: float) -> None:
    edge = np.full((240, 320), 50, np.float32)
    edge[:, 160:] = 200
    blurred = np.clip(cv2.GaussianBlur(edge, (0, 0), sigma) + 0.5, 0, 255).astype(np.uint8)
    width = np.sqrt(2 * np.pi * (sigma**2 + 0.8**2))
    assert edge_width_px(blurred) == pytest.approx(width, rel=0.1)


def test_blur() -> None:
    finding = blur(seen([np.asarray(cv2.GaussianBlur(image, (0, 0), 2.5), np.uint8) for image in GOOD]))
    assert finding is not None and finding.found


def test_blur_of_a_few_images_in_a_row_has_their_frame() -> None:
    def blurred(image: Image) -> Image:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), 2.5), np.uint8)

    spell = blur(seen([blurred(image) if i in (5, 6, 7) else image for i, image in enumerate(GOOD)]))
    one = blur(seen([blurred(image) if i == 5 else image for i, image in enumerate(GOOD)]))
    assert spell is not None and spell.found and spell.frames == (5,)
    assert one is not None and not one.found


def veiled(images: list[Image], contrast: float) -> list[Image]:
    """Returns the images with so much of their contrast, and as bright as fog."""
    rng = np.random.default_rng(0)
    light = [contrast * image + (1 - contrast) * 200 + rng.normal(0, 1.6, image.shape) for image in images]
    return [np.clip(each, 0, 255).astype(np.uint8) for each in light]


def test_haze_leaves_nothing_dark() -> None:
    finding = haze(seen(veiled(GOOD, 0.15)))
    assert finding is not None and finding.found and finding.values["dark_over_bright"] > 0.75


def test_haze_of_one_camera_of_a_pair_is_found() -> None:
    rig = Rig.stereo(CAMERA, 0.1)
    shots = tuple(
        Shot(i, i * FRAME_NS, {"left": image, "right": foggy})
        for i, (image, foggy) in enumerate(zip(GOOD, veiled(GOOD, 0.15), strict=True))
    )
    finding = haze(Examination(rig, shots, np.arange(len(GOOD)) * FRAME_NS))
    assert finding is not None and finding.found


@pytest.mark.parametrize("place", ["wall&motion=sideways", "moon&motion=drive", "indoor&motion=walk"])
def test_an_even_place_is_not_hazy(place: str) -> None:
    finding = haze(examination(open_sequence(f"sim:tiny?place={place}", seed=730), 0, 10))
    assert finding is not None and not finding.found


def test_of_a_blurred_or_a_bare_image_no_haze_is_known() -> None:
    rng = np.random.default_rng(0)
    foggy = [np.asarray(cv2.GaussianBlur(image, (0, 0), 3), np.uint8) for image in veiled(GOOD, 0.15)]
    assert haze(seen(foggy)) is None
    assert haze(seen([(150 + rng.normal(0, 1.6, (240, 320))).astype(np.uint8) for _ in range(5)])) is None


def test_an_even_place_that_the_camera_passes_is_not_hazy() -> None:
    finding = haze(seen([*GOOD, *veiled(GOOD, 0.15)]))
    assert finding is not None and not finding.found


def test_a_bare_wall_has_no_texture() -> None:
    rng = np.random.default_rng(0)
    finding = low_texture(seen([(150 + rng.normal(0, 1.6, (240, 320))).astype(np.uint8) for _ in range(5)]))
    assert finding is not None and finding.found


def test_one_jump_of_the_exposure_has_its_frame_and_gain() -> None:
    images = [
        image if i < 6 else np.clip(image.astype(float) * 1.4, 0, 255).astype(np.uint8)
        for i, image in enumerate(GOOD[:1] * 10)
    ]
    finding = exposure_jumps(seen(images))
    assert finding is not None and finding.found and finding.frames == (6,)
    assert finding.values["largest_gain"] == pytest.approx(1.4, rel=0.03)


def test_missing_frames_are_counted() -> None:
    times_ns = np.array([0, 1, 2, 3, 5, 6, 7, 10, 11, 12]) * FRAME_NS
    finding = dropped(seen(GOOD, times_ns))
    assert finding is not None and finding.found
    assert finding.values["missing_share"] == pytest.approx(3 / 12) and finding.frames[0] == 7


def test_repeated_images_have_their_frames() -> None:
    images = [*GOOD[:4], GOOD[3], *GOOD[5:]]
    finding = repeated(seen(images))
    assert finding is not None and finding.found and finding.frames == (4,)


def test_images_that_hardly_differ_are_not_one() -> None:
    rng = np.random.default_rng(0)
    images = [GOOD[0].copy() for _ in range(10)]
    for image in images:  # a compressed film of a scene at rest: a few pixels change by a level
        image[rng.random(image.shape) < 0.1] += 1
    finding = repeated(seen(images))
    assert finding is not None and not finding.found


def test_the_camera_s_motion_is_no_jump_of_the_exposure() -> None:
    brighter = np.clip(WIDE * np.linspace(0.4, 1.6, WIDE.shape[1]), 0, 255).astype(np.uint8)  # to the right
    images = [np.ascontiguousarray(brighter[:, 24 * i : 24 * i + 320]) for i in range(10)]
    assert images[1].mean() > 1.05 * images[0].mean()
    finding = exposure_jumps(seen(images))
    assert finding is not None and finding.values["largest_gain"] < 1.03


def test_of_few_corners_that_are_followed_no_gain_is_known() -> None:
    """Each image shows another place."""
    images = [picture(seed) for seed in range(8)]
    brighter = [np.clip(image * (1.4 if i % 2 else 1.0), 0, 255).astype(np.uint8) for i, image in enumerate(images)]
    assert exposure_jumps(seen(brighter)) is None


def test_something_on_the_lens_stays_where_it_is() -> None:
    spots = [(60, 60), (150, 90), (240, 60), (80, 170), (170, 180), (250, 160)]
    spotted = [image.copy() for image in LONG]
    for image in spotted:
        for spot in spots:
            cv2.circle(image, spot, 8, 15, -1)
    found, clean = on_lens(seen(spotted)), on_lens(seen(LONG))
    assert found is not None and found.found
    assert clean is not None and not clean.found
    row, column = np.nonzero(fixed_edges(seen(spotted))[0])
    apart = np.linalg.norm(np.column_stack([column, row])[:, None] - np.array(spots), axis=2).min(axis=1)
    assert len(apart) > 100 and np.percentile(apart, 90) < 10


def test_drops_show_the_scene_so_their_edges_change_their_sign() -> None:
    finding = on_lens(examination(open_sequence("sim:tiny?fault=rain", seed=731), 0, 49))
    assert finding is not None and finding.found and finding.values["more_often"] > 2


def test_a_smear_takes_contrast_where_corners_pass_it() -> None:
    smeared = examination(open_sequence("sim:tiny?fault=smear", seed=1), 0, 49)
    clean = examination(open_sequence("sim:tiny", seed=1), 0, 49)
    found, other = on_lens(smeared), on_lens(clean)
    assert found is not None and found.found and found.values["smeared_share"] > 0.025
    assert other is not None and not other.found
    gain, known = gains(clean, clean.tracked.uv)
    assert known.sum() > 50 and abs(gain[known]).max() < 0.3


def test_a_smear_where_no_corner_passes_is_an_island() -> None:
    """At the smear of seed 710, the road has no corners, and those of the street come from its middle."""
    smeared = examination(open_sequence("sim:tiny?fault=smear", seed=710), 0, 49)
    clean = examination(open_sequence("sim:tiny", seed=710), 0, 49)
    found, other = on_lens(smeared), on_lens(clean)
    assert found is not None and found.found and found.values["directions"] >= 7
    assert other is not None and not other.found


def test_of_a_camera_at_rest_nothing_is_said_of_the_lens() -> None:
    assert on_lens(seen(GOOD[:1] * 8)) is None
