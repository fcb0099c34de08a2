"""Simulated flights as a person has them whose calibration is off by what the methods allow for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.evaluation.corrected_rig import corrected
from ispom.geometry import Array
from ispom.sequences.rectification import Rectification, remapped
from ispom.solvers.right_camera import LAG, PAIR, Q1, Q2
from ispom.types import Corrections, LensCorrection, Measurement, PairCorrection, Sequence, is_stereo

SURE = 1e-30
"""Variance with which any error is significant, see corrected_rig."""


def miscalibrated(sequence: Sequence, seed: int) -> Sequence:
    """The sequence with a rig whose cameras are off as `drawn`: its pairs are rectified by that."""
    pair, lens = drawn(sequence, seed)
    found = Corrections(
        lens=LensCorrection.of(-lens, SURE * np.eye(len(lens))), pair=PairCorrection.of(-pair, SURE * np.eye(PAIR))
    )
    wrong = corrected(sequence.rig, found).rig
    right_from_left = wrong.rig_from_right.inverse() @ wrong.rig_from_left
    rectification = Rectification.of(wrong.camera("left"), wrong.camera("right"), right_from_left)

    def load(i: int) -> Measurement:
        exposure = sequence[i]
        if not is_stereo(exposure):
            return exposure
        left, right = rectification.left_maps, rectification.right_maps
        return exposure.with_images(left=remapped(exposure.left, left), right=remapped(exposure.right, right))

    return replace(sequence, rig=rectification.placed(wrong), load=load)


def drawn(sequence: Sequence, seed: int) -> tuple[Array, Array]:
    """(E,) errors of the pair by right_camera.TERMS, but for those that no rig holds, and (2,) focal length and radial
    distortion of the video camera: each from the deviation that its method has for it before any data."""
    rng = np.random.default_rng(1000 + seed)
    pair = rng.normal(0, ModernStereoConfig().pair_sigma(sequence.rig.camera("left").fx))
    pair[[LAG, Q1, Q2]] = 0.0
    return pair, rng.normal(0, ModernMonocularConfig().lens_sigma())
