"""Each fault of what a camera sees or writes is there, at the size stated, on grey images and on coloured ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.simulation.scenario.calibrations import Unlevel
from ispom.simulation.scenario.fault import Exchanged, Fault
from ispom.simulation.scenario.images import Blocked, Darkness, Defocus, ExposureJumps, Rain
from ispom.simulation.scenario.spoilt import HAZE, Fog, Jpeg, MotionBlur, MovingPatch, Noise, Smear
from ispom.types import Frame, Sequence, as_grey, images_of
from tests.simulation.scenario.conftest import pair, video

OF_IMAGES: tuple[Fault, ...] = (
    Darkness(), ExposureJumps(every_s=0.2), Defocus(), Blocked(camera="all"), Rain(), MotionBlur(), Fog(), Smear(),
    MovingPatch(), Noise(), Jpeg(),
)  # fmt: skip


@pytest.fixture
def grey(plain: Sequence) -> Sequence:
    def load(i: int) -> Frame:
        seen = plain[i]
        assert isinstance(seen, Frame)
        return seen.with_images(**{name: as_grey(image) for name, image in seen.images.items()})

    return replace(plain, load=load)


def _alike(plain: Sequence) -> list[int]:
    """Video frames with the same image."""
    first = video(plain, 0).image
    return [n for n in range(30) if np.array_equal(video(plain, n).image, first)]


@pytest.mark.parametrize("fault", OF_IMAGES, ids=lambda fault: type(fault).__name__)
def test_every_fault_of_images_takes_grey_and_colour(plain: Sequence, grey: Sequence, fault: Fault) -> None:
    for sequence in (plain, grey):
        n = 8  # within a bright period of the exposure
        before, after = video(sequence, n).image, video(fault.on(sequence, 4), n).image
        assert after.shape == before.shape and after.dtype == np.uint8 and not np.array_equal(before, after)
        assert np.array_equal(after, video(fault.on(sequence, 4), n).image), "the same seed gives the same bytes"


def test_fog_takes_contrast(plain: Sequence) -> None:
    seen = pair(Fog(contrast=0.2).on(plain, 0), 0).left.astype(float)
    bright, dark = seen[25:35, 30:38].mean(), seen[60:].mean()
    assert bright - dark == pytest.approx(0.2 * (200 - 128), abs=0.5)
    assert dark == pytest.approx(0.2 * 128 + 0.8 * HAZE, abs=0.3)


def test_noise_is_as_large_as_stated(plain: Sequence) -> None:
    flat = video(Noise(sigma=12).on(plain, 0), 0).image[45:].astype(float)
    assert flat.mean() == pytest.approx(128, abs=0.5) and flat.std() == pytest.approx(12, rel=0.05)


def test_motion_blur_spreads_along_one_direction_that_changes(plain: Sequence) -> None:
    found = MotionBlur(length_px=9).on(plain, 0)
    spread = []
    for n in _alike(plain):
        difference = np.abs(video(found, n).image.astype(float) - 128)[..., 0] > 8
        spread.append((np.ptp(np.flatnonzero(difference.any(0))), np.ptp(np.flatnonzero(difference.any(1)))))
    assert all(19 <= size <= 19 + 10 for both in spread for size in both) and len(set(spread)) > 1


def test_a_smear_stays_and_is_soft(plain: Sequence) -> None:
    found = Smear(radius_percent=20).on(plain, 2)
    changes = [video(found, n).image.astype(int) - video(plain, n).image for n in _alike(plain)[:2]]
    assert np.array_equal(changes[0], changes[1]), "the same scene, the same smear"
    touched = np.abs(video(found, 3).image.astype(int) - video(plain, 3).image).max(axis=2)
    assert 0 < (touched > 0).mean() < 0.3 and np.abs(np.diff(touched, axis=1)).max() < 40


def test_an_object_moves_at_its_speed_with_its_texture(plain: Sequence) -> None:
    found = MovingPatch(width_percent=25, height_percent=50, speed_percent=30).on(plain, 1)
    where = []
    for n in (0, 6):
        changed = (np.abs(video(found, n).image.astype(int) - video(plain, n).image).max(axis=2) > 0).any(axis=0)
        columns = np.flatnonzero(changed)
        where.append(columns)
        assert 0.8 * 20 <= np.ptp(columns) <= 20
    step = abs(where[1].mean() - where[0].mean())
    interval_s = (video(plain, 6).time_ns - video(plain, 0).time_ns) * 1e-9
    assert step == pytest.approx(0.3 * 80 * interval_s, abs=1)


def test_an_unlevel_pair_is_lower_on_the_right(plain: Sequence) -> None:
    found = Unlevel(rows_px=4).on(plain, 0)
    for n in (0, 3):
        assert np.array_equal(pair(found, n).right[4:], pair(plain, n).right[:-4])
        assert np.array_equal(pair(found, n).left, pair(plain, n).left)


def test_exchanged_images_change_places(plain: Sequence) -> None:
    before, after = pair(plain, 2), pair(Exchanged().on(plain, 0), 2)
    assert np.array_equal(before.left, after.right) and np.array_equal(before.right, after.left)
    assert images_of(video(Exchanged().on(plain, 0), 2)).keys() == {"video"}
