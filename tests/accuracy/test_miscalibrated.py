"""What is wrong with the cameras of a flight is as drawn, and is found by the method that allows for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.sequences.formats.simulated import open_simulated
from ispom.solvers.right_camera import OFFSET_X, OFFSET_Y, ROLL
from ispom.types import is_stereo
from tests.accuracy.miscalibrated import drawn, miscalibrated
from tests.alone import run


@pytest.mark.slow
def test_a_pair_is_off_as_drawn(tmp_path: Path) -> None:
    plain = open_simulated("tiny", 0, tmp_path, duration_s=2.0)
    wrong, (pair, lens) = miscalibrated(plain, 0), drawn(plain, 0)
    assert wrong.rig.video is not None and plain.rig.video is not None
    np.testing.assert_allclose(wrong.rig.video.fx / plain.rig.video.fx, 1 - lens[0], rtol=1e-3)
    pairs = [e for i, k in enumerate(wrong.kinds) if k == "stereo" and is_stereo(e := wrong[i])]
    *_, last = run(ModernStereoConfig().build(wrong.rig), pairs)
    found = last.calibration.pair
    assert found is not None and found.covariance is not None
    sigma = np.sqrt(np.diag(found.covariance))
    for term in (OFFSET_X, OFFSET_Y, ROLL):
        assert abs(found.values[term] - pair[term]) < min(4 * sigma[term], 0.2 * abs(pair[term]))
