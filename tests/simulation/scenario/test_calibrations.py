"""Wrong calibrations: what is told differs from what made the images by what was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import rotation_angle_rad
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.scenario.calibrations import WrongBaseline, WrongLens, WrongMount, WrongPair, WrongShutter
from ispom.simulation.scenario.fault import Fault
from ispom.types import Sequence
from tests.simulation.scenario.conftest import pair


def test_the_stated_lens_is_off_by_the_fault(plain: Sequence) -> None:
    was = plain.rig.camera("video")
    stated = WrongLens(focal_percent=2, centre_x_px=3, k1=0.1).on(plain, 0).rig.camera("video")
    assert (stated.fx, stated.fy) == pytest.approx((1.02 * was.fx, 1.02 * was.fy))
    assert (stated.cx - was.cx, stated.cy - was.cy) == pytest.approx((3, 0))
    assert stated.distortion[0] - was.distortion[0] == pytest.approx(0.1)
    both = WrongLens(camera="stereo", focal_percent=-1).on(plain, 0).rig
    assert both.camera("left").fx == both.camera("right").fx == pytest.approx(0.99 * plain.rig.camera("left").fx)


def test_the_stated_baseline_is_off_by_its_percentage(plain: Sequence) -> None:
    assert WrongBaseline(percent=5).on(plain, 0).rig.baseline_m == pytest.approx(1.05 * plain.rig.baseline_m)


def test_the_stated_mount_is_off_by_angle_and_shift(plain: Sequence) -> None:
    stated = WrongMount(yaw_deg=0.7, x_m=0.03).on(plain, 0).rig.rig_from_video
    off = plain.rig.rig_from_video.inverse() @ stated
    assert np.degrees(rotation_angle_rad(off.rotation)) == pytest.approx(0.7)
    np.testing.assert_allclose(off.translation, [0.03, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("asked", "axis", "sign"), [({"yaw_deg": 2.0}, 0, -1), ({"yaw_deg": 0.0, "pitch_deg": 2.0}, 1, 1)]
)
def test_a_turned_right_camera_moves_its_image(plain: Sequence, asked: dict, axis: int, sign: int) -> None:
    """A camera that looks further to the right (yaw > 0) shows things further to the left; pitch > 0 looks up."""
    camera = plain.rig.camera("right")
    seen = [pair(s, 0).right[..., 0] > 164 for s in (plain, WrongPair(**asked).on(plain, 0))]
    before, after = (np.array(np.nonzero(mask)[::-1]).mean(axis=1)[axis] for mask in seen)
    centre = (camera.cx, camera.cy)[axis]
    angle = np.arctan((before - centre) / camera.fx) + sign * np.radians(2.0)
    assert after == pytest.approx(centre + camera.fx * np.tan(angle), abs=0.6)


@pytest.mark.parametrize(
    ("fault", "exact"),
    [
        (WrongLens(), {"pair_sigma"}),
        (WrongLens(camera="stereo"), {"video_sigma"}),
        (WrongBaseline(), {"video_sigma"}),
        (WrongPair(), {"video_sigma"}),
        (WrongShutter(), set()),
        (WrongMount(), {"pair_sigma", "video_sigma"}),
    ],
)
def test_what_is_wrong_is_not_called_exact(plain: Sequence, fault: Fault, exact: set[str]) -> None:
    stated_rig = fault.on(replace(plain, rig=simulated_rig(0.1)), 0).rig
    assert {name for name in ("video_sigma", "pair_sigma") if getattr(stated_rig, name) is not None} == exact


def test_the_left_images_and_the_rig_stay(plain: Sequence) -> None:
    found = WrongPair().on(plain, 0)
    assert found.rig.camera("right") is plain.rig.camera("right") and np.array_equal(
        pair(found, 2).left, pair(plain, 2).left
    )
