"""Rows are exposed one after the other, by as much as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.simulation.cameras import NOISE_SIGMA, simulated_rig
from ispom.simulation.source import STRIP_ROWS, Source

T_NS, READ_OUT_NS = 1_500_000_000, 60_000_000
GLOBAL = Source(1, False, 0.25, motion="rotation")
ROLLING = replace(GLOBAL, rolling_ns=READ_OUT_NS)


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a.astype(float) - b).mean())


def test_each_strip_is_seen_at_its_own_time() -> None:
    seen, row = ROLLING.render(T_NS, "video", 1), 0
    strips = ROLLING.strips(simulated_rig(0.25).camera("video"))
    for n in (0, len(strips) // 3, len(strips) - 1):
        strip, late_ns = strips[n]
        rows = slice(row := n * STRIP_ROWS, row + strip.height)
        then = GLOBAL.render(T_NS + late_ns, "video", 1)[rows]
        assert difference(seen[rows], then) < 1.4 * NOISE_SIGMA
        if n != len(strips) // 3:
            middle = GLOBAL.render(T_NS, "video", 1)[rows]
            assert difference(seen[rows], middle) > 2 * NOISE_SIGMA, "and not when the middle was"


def test_the_read_out_takes_as_long_as_stated() -> None:
    camera = simulated_rig().camera("left")
    strips = ROLLING.strips(camera)
    assert sum(strip.height for strip, _ in strips) == camera.height
    late = np.array([late_ns for _, late_ns in strips])
    a_strip = READ_OUT_NS * STRIP_ROWS / camera.height
    assert abs((late[-1] - late[0]) - READ_OUT_NS) <= 1.1 * a_strip and abs(late.sum()) < len(late)
    assert (np.diff(late) > 0).all()


def test_without_it_all_bytes_are_the_same() -> None:
    assert np.array_equal(replace(ROLLING, rolling_ns=0).render(T_NS, "stereo", 1), GLOBAL.render(T_NS, "stereo", 1))
