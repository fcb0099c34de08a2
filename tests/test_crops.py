"""Rigs with little overlap, cut out of stereo pairs: the same pixels show the same directions."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.types import Frame
from tests.crops import OUTER, cropped_pair, only_cameras
from tests.rounds import SCENARIOS

PAIRS = next(s for s in SCENARIOS if s.name == "moving" and s.kinds == {"stereo"}).sequence(4)
VIDEO = next(s for s in SCENARIOS if s.name == "moving" and s.kinds == {"video"}).sequence(4)


@pytest.mark.parametrize(("overlap", "width"), [(0.0, 80), (0.1, 84), (0.3, 94), (1.0, 160)])
def test_crops_are_the_outer_parts(overlap: float, width: int) -> None:
    sequence = cropped_pair(PAIRS, overlap)
    frame, pair = sequence[2], PAIRS[2]
    assert isinstance(frame, Frame) and isinstance(pair, Frame)
    assert frame.kind == "cameras" and frame.time_ns == pair.time_ns and sequence.kinds == ("cameras",) * 4
    np.testing.assert_array_equal(frame.images[OUTER[0]], pair.left[:, :width])
    np.testing.assert_array_equal(frame.images[OUTER[1]], pair.right[:, 160 - width :])
    shared = (2 * width - 160) / width
    assert shared == pytest.approx(overlap, abs=0.02)


def test_rays_of_crops_are_those_of_the_pair() -> None:
    rig = cropped_pair(PAIRS, 0.3).rig
    cut = 160 - rig.camera(OUTER[1]).width
    uv = np.array([[10.0, 20.0], [70.0, 100.0]])
    for name, side, shift in zip(OUTER, ("left", "right"), (0, cut), strict=True):
        np.testing.assert_allclose(
            rig.camera(name).normalise(uv), PAIRS.rig.camera(side).normalise(uv + np.array([shift, 0]))
        )
        np.testing.assert_array_equal(rig.rig_from(name).matrix, PAIRS.rig.rig_from(side).matrix)


def test_single_cameras_of_a_rig() -> None:
    sequence = only_cameras(cropped_pair(PAIRS, 0.1), [OUTER[1]])
    frame = sequence[0]
    assert isinstance(frame, Frame)
    assert list(frame.images) == list(sequence.rig.cameras) == [OUTER[1]] and frame.kind == "cameras"


def test_what_cannot_be_cropped_is_refused() -> None:
    with pytest.raises(InputError, match="no stereo frames"):
        cropped_pair(VIDEO, 0.1)
    with pytest.raises(InputError, match="from 0 to 1"):
        cropped_pair(PAIRS, 1.5)
    with pytest.raises(InputError, match="no camera middle"):
        only_cameras(PAIRS, ["middle"])
