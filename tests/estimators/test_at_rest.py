"""A real platform that does not move: stereo poses stay together."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from ispom.estimators.paper.stereo import StereoConfig
from ispom.sequences import open_sequence
from ispom.types import StereoPair
from tests.alone import run

REAL = Path(__file__).parents[2] / ".." / "shared" / "data" / "euroc_v1_01_start"


@pytest.mark.skipif(not REAL.is_dir(), reason="the EuRoC recording is not in ../shared/data")
@pytest.mark.parametrize("matching", ["sift", "klt"])
def test_a_platform_at_rest_stays_within_a_centimetre(matching: Literal["sift", "klt"]) -> None:
    sequence = open_sequence(str(REAL))
    pairs = [exposure for i in range(len(sequence)) if isinstance(exposure := sequence[i], StereoPair)]
    steps = list(run(StereoConfig(matching=matching).build(sequence.rig), pairs))
    poses = [step.world_from_frame for step in steps]
    assert len(poses) == 20 and None not in poses
    assert max(np.linalg.norm(pose.translation) for pose in poses if pose) <= 0.010
