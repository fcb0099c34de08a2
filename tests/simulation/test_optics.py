"""Cameras of other kinds on the simulated rig: what is told of them is what they see through."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.features.row_search import PointSearch
from ispom.sequences.formats.simulated import open_scenario
from ispom.simulation.cameras import Optics, simulated_rig
from ispom.simulation.scenario.scenario import scenario_of_words
from ispom.types import EXACT_PAIR, FrameName, Sequence, is_stereo, is_video

NAMES: tuple[FrameName, ...] = ("video", "left", "right")


def opened(words: str, folder: Path) -> Sequence:
    return open_scenario(scenario_of_words(f"tiny?duration_s=0.1&{words}"), 0, folder)


@pytest.mark.parametrize("name", NAMES)
def test_portrait_exchanges_the_sides(name: FrameName) -> None:
    """What is seen right of the axis in landscape is seen below it."""
    plain, upright = simulated_rig().camera(name), simulated_rig(1.0, Optics(portrait=True)).camera(name)
    assert (upright.width, upright.height) == (plain.height, plain.width)
    xyz = np.array([[0.3, -0.2, 1.0], [-0.5, 0.3, 1.0]])
    np.testing.assert_allclose(upright.project(xyz[:, [1, 0, 2]]), plain.project(xyz)[:, ::-1])


@pytest.mark.parametrize("name", NAMES)
def test_another_width_keeps_the_field_of_view(name: FrameName) -> None:
    plain, wide = simulated_rig().camera(name), simulated_rig(1.0, Optics(width_px=3840)).camera(name)
    assert (wide.width, wide.height) == (3840, 2880)
    corner, far = ((np.array([[c.width - 0.5, c.height - 0.5]])) for c in (plain, wide))
    np.testing.assert_allclose(plain.normalise(corner), wide.normalise(far), atol=1e-9)


def test_a_fisheye_lens_sees_more_and_its_pixels_have_rays() -> None:
    plain, fisheye = simulated_rig().camera("video"), simulated_rig(1.0, Optics(fisheye=True)).camera("video")
    sides = np.array([[0.0, fisheye.cy], [fisheye.width - 1.0, fisheye.cy]])
    angles, others = (np.degrees(np.arctan(c.normalise(sides)[:, 0])) for c in (fisheye, plain))
    assert 115 < angles[1] - angles[0] < 135 and others[1] - others[0] < 80
    corners = np.array([[0.0, 0.0], [fisheye.width - 1.0, fisheye.height - 1.0]])
    rays = np.column_stack([fisheye.normalise(corners), np.ones(2)])
    np.testing.assert_allclose(fisheye.project(rays), corners, atol=1e-3)


def test_the_stated_rig_knows_the_shutter_unless_it_is_wrong(tmp_path: Path) -> None:
    stated_rig = opened("rolling_shutter_ms=20", tmp_path).rig
    for name in NAMES:
        assert stated_rig.camera(name).line_delay_s * (stated_rig.camera(name).height - 1) == pytest.approx(0.02)
    silent = opened("rolling_shutter_ms=20&fault=wrong-shutter", tmp_path).rig
    slower = opened("rolling_shutter_ms=20&fault=wrong-shutter:percent=10", tmp_path).rig
    assert [silent.camera(n).line_delay_s for n in NAMES] == [0, 0, 0]
    assert slower.camera("left").line_delay_s == pytest.approx(1.1 * stated_rig.camera("left").line_delay_s)


def test_a_late_right_camera_is_no_exact_pair(tmp_path: Path) -> None:
    assert opened("right_late_ms=5", tmp_path).rig.pair_sigma is None
    assert opened("portrait=true", tmp_path).rig.pair_sigma == EXACT_PAIR


def test_a_pair_of_fisheye_lenses_is_rectified(tmp_path: Path) -> None:
    """Points are found in the same row of the right image."""
    sequence = opened("fisheye=true", tmp_path)
    pair = next(e for i in range(len(sequence)) if is_stereo(e := sequence[i]))
    camera = sequence.rig.camera("left")
    assert camera == sequence.rig.camera("right") and camera.lens == "opencv" and not camera.distortion
    assert pair.left.shape[:2] == (camera.height, camera.width)
    uv = np.stack(np.meshgrid(np.arange(120.0, 520, 40), np.arange(100.0, 400, 40)), axis=-1).reshape(-1, 2)
    grey = [image.mean(axis=2).astype(np.uint8) for image in (pair.left, pair.right)]
    found, lower, *_ = PointSearch().follow(grey[0], grey[1], uv.astype(np.float32), np.full(len(uv), 8, np.float32))
    assert np.isfinite(found).mean() > 0.5
    assert np.nanmedian(np.abs(lower)) < 0.15


def test_images_have_the_requested_size(tmp_path: Path) -> None:
    sequence = opened("width_px=100&portrait=true", tmp_path)
    frame = sequence[0]
    assert is_video(frame) and frame.image.shape == (133, 100, 3)


def test_a_width_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="width_px is 8"):
        opened("width_px=8", tmp_path)
