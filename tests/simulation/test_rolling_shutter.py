"""Rows are exposed one after the other, by as much as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.simulation.cameras import simulated_rig
from ispom.simulation.source import STRIP_NS, Source

T_NS, READ_OUT_NS = 1_500_000_000, 20_000_000
GLOBAL = Source(1, False, 0.25, motion="rotation")
ROLLING = replace(GLOBAL, rolling_ns=READ_OUT_NS)


def test_each_strip_is_seen_at_its_own_time() -> None:
    seen, middle = ROLLING.light("video", T_NS, 1), GLOBAL.light("video", T_NS, 1)
    strips = ROLLING.strips(simulated_rig(0.25).camera("video"))
    for n in (len(strips) // 4, 3 * len(strips) // 4):
        strip, late_ns = strips[n]
        first = sum(above.height for above, _ in strips[:n])
        rows = slice(first + 1, first + strip.height - 1)  # edges look over the rows beside them
        then = GLOBAL.light("video", T_NS + late_ns, 1)
        np.testing.assert_allclose(seen[rows], then[rows], atol=0.1)
        assert np.abs(seen[rows] - middle[rows]).mean() > 0.2, "not when the middle was"


def test_the_read_out_takes_as_long_as_stated() -> None:
    camera = simulated_rig().camera("left")
    strips = ROLLING.strips(camera)
    assert sum(strip.height for strip, _ in strips) == camera.height
    late = np.array([late_ns for _, late_ns in strips])
    assert abs((late[-1] - late[0]) - READ_OUT_NS) <= 1.1 * STRIP_NS and abs(late.sum()) < len(late)
    assert (np.diff(late) > 0).all()


def test_without_it_all_bytes_are_the_same() -> None:
    assert np.array_equal(replace(ROLLING, rolling_ns=0).render(T_NS, "stereo", 1), GLOBAL.render(T_NS, "stereo", 1))
