"""Rows are exposed one after the other, by as much as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.simulation.cameras import simulated_rig
from ispom.simulation.source import Source

T_NS, READ_OUT_NS = 1_500_000_000, 20_000_000
GLOBAL = Source(1, False, 0.25)
ROLLING = replace(GLOBAL, rolling_ns=READ_OUT_NS)


@pytest.mark.parametrize("motion", ["rotation", "flight"])
def test_each_row_is_seen_at_its_own_time(motion: str) -> None:
    middle, seen = (replace(each, motion=motion) for each in (GLOBAL, ROLLING))
    late_ns = ROLLING.late_ns(simulated_rig(0.25).camera("video"))
    image, still = seen.light("video", T_NS, 1), middle.light("video", T_NS, 1)
    for row in (len(late_ns) // 4, 3 * len(late_ns) // 4):
        then = middle.light("video", T_NS + int(late_ns[row]), 1)
        # Edges look over the rows beside them, which are not exposed with this one.
        difference = np.abs(image[row] - then[row]).max(axis=1)
        assert np.median(difference) < 0.02 and np.quantile(difference, 0.9) < 0.5
        assert np.abs(image[row] - still[row]).mean() > 0.2, "not when the middle was"


def test_the_read_out_takes_as_long_as_stated() -> None:
    camera = simulated_rig().camera("left")
    late_ns = ROLLING.late_ns(camera)
    assert len(late_ns) == camera.height
    assert late_ns[-1] - late_ns[0] == READ_OUT_NS and late_ns.sum() == 0
    assert np.ptp(np.diff(late_ns)) <= 1


def test_without_it_all_bytes_are_the_same() -> None:
    assert np.array_equal(replace(ROLLING, rolling_ns=0).render(T_NS, "stereo", 1), GLOBAL.render(T_NS, "stereo", 1))
