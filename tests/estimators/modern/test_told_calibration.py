"""A rig that says how sure its calibration is: the methods start from that instead of their settings."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.geometry import Array
from ispom.solvers.right_camera import AHEAD, FOCAL, K1, LAG, OFFSET_X, OFFSET_Y, P1, PAIR, YAW
from ispom.types import EXACT_LENS, EXACT_PAIR, Corrections, LensSigma, Measurement, PairSigma, Rig, Sequence, is_stereo
from tests.estimators.modern.setups import setup_of

PIXEL = PairSigma(offset_px=1.0, turn_deg=2.0, focal=0.03, radial=0.04, decentring=0.05, lag_s=0.06)


def test_what_is_told_stands_in_the_terms_of_the_pair() -> None:
    found = ModernStereoConfig(offset_sigma_px=5.0).pair_sigma(400.0, PIXEL)
    assert found[[OFFSET_X, OFFSET_Y]] == pytest.approx(1 / 400)
    assert found[[YAW, AHEAD]] == pytest.approx(np.radians(2.0))
    assert found[[FOCAL, K1, P1, LAG]] == pytest.approx([0.03, 0.04, 0.05, 0.06])


def test_without_a_word_the_settings_hold() -> None:
    assert ModernStereoConfig(offset_sigma_px=5.0).pair_sigma(400.0)[OFFSET_X] == pytest.approx(5 / 400)
    assert ModernMonocularConfig(focal_sigma=0.02, radial_sigma=0.03).lens_sigma() == pytest.approx([0.02, 0.03])
    assert ModernMonocularConfig().lens_sigma(LensSigma(0.1, 0.2)) == pytest.approx([0.1, 0.2])


def test_what_is_not_to_be_corrected_is_held_whatever_is_told() -> None:
    assert (ModernStereoConfig(self_calibration=False).pair_sigma(400.0, PIXEL) == np.zeros(PAIR)).all()
    assert (ModernMonocularConfig(self_calibration=False).lens_sigma(LensSigma(0.1, 0.2)) == 0).all()


@pytest.mark.parametrize("width_px", [5184, 640])
def test_pixels_of_the_file_are_those_of_its_cameras(width_px: int, flight: Sequence) -> None:
    """Wide images are tracked smaller."""
    camera = flight.rig.camera("left").scaled(width_px / flight.rig.camera("left").width)
    rig = flight.rig.changed(left=camera, right=camera, pair_sigma=PIXEL)
    assert setup_of(ModernStereoConfig().build(rig)).extra_sigma[OFFSET_X] == pytest.approx(1 / camera.fx)


def corrections(rig: Rig, exposures: list[Measurement]) -> tuple[Array, Array]:
    """What is found to be wrong with the pair, and with the video's lens."""
    stereo, monocular = ModernStereoConfig().build(rig), ModernMonocularConfig().build(rig)
    pair, lens, told = stereo.start(), monocular.start(), Corrections()
    for exposure in exposures:
        if is_stereo(exposure):
            pair, step = stereo.step(pair, exposure)
        else:
            lens, step = monocular.step(lens, exposure)
        told = told.updated(step.calibration)
    assert told.pair is not None and told.lens is not None
    return told.pair.values, told.lens.values


def test_exact_cameras_are_not_corrected(flight: Sequence, exposures: list[Measurement]) -> None:
    assert flight.rig.pair_sigma == EXACT_PAIR and flight.rig.video_sigma == EXACT_LENS
    pair, lens = corrections(flight.rig, exposures)
    assert np.abs(pair).max() < 1e-5 and np.abs(lens).max() < 1e-5
    pair, lens = corrections(flight.rig.changed(pair_sigma=None, video_sigma=None), exposures)
    assert np.abs(pair).max() > 1e-4 and np.abs(lens).max() > 1e-5
