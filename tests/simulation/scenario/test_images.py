"""Each fault of light and lens is there, at the size stated, and only while and where it is asked for."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.simulation.cameras import NOISE_SIGMA
from ispom.simulation.scenario.fault import Fault
from ispom.simulation.scenario.images import Blocked, Darkness, Defocus, ExposureJumps, Rain
from ispom.types import Sequence, images_of
from tests.simulation.scenario.conftest import pair, video


def test_darkness_takes_light_and_leaves_noise(plain: Sequence) -> None:
    dark = Darkness(factor=0.2).on(plain, 0)
    flat = video(dark, 3).image[45:].astype(float)
    assert flat.mean() == pytest.approx(0.2 * 128, abs=0.1)
    assert flat.std() == pytest.approx(NOISE_SIGMA * np.sqrt(1 - 0.2**2), rel=0.05)
    assert pair(dark, 0).right[20:40, 30].mean() == pytest.approx(0.2 * 200, abs=1)


def test_exposure_jumps_every_second_period(plain: Sequence) -> None:
    found = ExposureJumps(gain=1.5, every_s=0.5, camera="video").on(plain, 0)
    levels = [int(video(found, n).image[50, 50, 0]) for n in (0, 14, 16, 29, 31, 46)]
    assert levels == [128, 128, 192, 192, 128, 192]
    assert video(found, 16).image.max() == 255, "200 x 1.5 is cut off"
    assert pair(found, 2).left.max() == 200, "the other cameras keep their exposure"


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_defocus_spreads_an_edge_by_its_sigma(plain: Sequence, sigma: float) -> None:
    images = [video(Defocus(sigma_px=sigma).on(plain, seed), 0).image[24:36, :30] for seed in range(40)]
    slope = np.diff(np.mean(images, axis=(0, 1, 3)))  # an edge's slope is the blur itself
    at = np.arange(len(slope))
    middle = (slope * at).sum() / slope.sum()
    near = np.abs(at - middle) < 4 * sigma
    width = np.sqrt((slope * (at - middle) ** 2)[near].sum() / slope[near].sum())
    assert width == pytest.approx(sigma, rel=0.1)


def test_a_blocked_camera_sees_its_cover(plain: Sequence) -> None:
    found = Blocked(camera="left", share=0.25).on(plain, 0)
    seen = pair(found, 0)
    assert seen.left[:, :40].mean() == pytest.approx(10, abs=0.3) and seen.left[:, :40].std() > 1
    assert np.array_equal(seen.left[:, 40:], pair(plain, 0).left[:, 40:])
    assert np.array_equal(seen.right, pair(plain, 0).right)


def test_drops_stay_on_the_lens_and_cover_what_they_say(plain: Sequence) -> None:
    rain = Rain(drops=5, radius_percent=6)
    inside, _, _ = rain.drawn(("video", 60, 80), 3)
    disc = np.pi * (0.06 * 80) ** 2
    assert 0.5 * disc < inside.sum() <= 5 * disc * 1.05
    for n in (0, 4):
        before, after = video(plain, n).image, video(rain.on(plain, 3), n).image
        assert np.array_equal(before[~inside], after[~inside])
    square = np.abs(video(plain, 0).image.astype(int) - video(rain.on(plain, 3), 0).image).max(axis=2) > 0
    assert square.any() and not (square & ~inside).any()


@pytest.mark.parametrize(
    "fault", [Darkness(from_s=0.5, until_s=1.0), Rain(from_s=0.5, until_s=1.0), Defocus(from_s=0.5, until_s=1.0)]
)
def test_outside_of_its_spell_all_bytes_are_the_same(plain: Sequence, fault: Fault) -> None:
    found = fault.on(plain, 0)
    for i, time_ns in enumerate(plain.times_ns):
        a, b = images_of(plain[i]), images_of(found[i])
        same = all(np.array_equal(a[name], b[name]) for name in a)
        assert same == (not 0.5 <= time_ns * 1e-9 < 1.0)


def test_the_same_seed_gives_the_same_bytes(plain: Sequence) -> None:
    for fault in (Darkness(), Rain(), Defocus(), Blocked()):
        one, again, other = (video(fault.on(plain, seed), 2).image for seed in (5, 5, 6))
        assert np.array_equal(one, again) and not np.array_equal(one, other)
