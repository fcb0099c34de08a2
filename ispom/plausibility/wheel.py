"""Whether the increments of wheels can be metres and radians since the row before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.plausibility.doubt import Doubt

FASTEST_M_S = 100.0
"""Trains and racing cars on wheels reach 90 m/s."""
GRIP_M_S2 = 12.0
"""Tyres transmit about 1 g: no vehicle on wheels accelerates for long with more."""
CORNER_M_S2 = 45.0
"""Racing cars, pressed down by the air, turn with up to 4.5 g."""
FASTEST_TURN = 6.3
"""[rad/s] A whole turn per second: small robots turn at half of that."""
LEAST_ROWS = 8
"""A growth over fewer rows may be a start."""
MOVED_M, MOVED_SIGMAS = 10.0, 6.0


def wheel_doubts(where: str, times_ns: NDArray[np.int64], distances: Array, turns: Array | None) -> tuple[Doubt, ...]:
    """Returns doubts about increments (N - 1,) [m], perhaps rotations (N - 1,) [rad], between times (N,) [ns]."""
    seconds = np.diff(times_ns) * 1e-9
    if len(seconds) < 2:
        return ()
    if found := _cumulative(where, seconds, distances):
        return found
    speeds, out = distances / seconds, []
    if (fast := float(np.percentile(np.abs(speeds), 90))) > FASTEST_M_S:
        text = f"{where}: its distances are {fast:.4g} m/s, faster than any wheel: this looks like millimetres"
        out.append(Doubt("wheel_unit", f"{text} ({fast * 1e-3:.3g} m/s), or ticks; give metres since the row before."))
        speeds = speeds * 1e-3
    if turns is not None:
        rates = turns / seconds
        rate, pull = float(np.percentile(np.abs(rates), 95)), float(np.percentile(np.abs(rates * speeds), 95))
        if rate > FASTEST_TURN or pull > CORNER_M_S2:
            text = f"{where}: its rotations are {rate:.3g} rad/s, a sideways acceleration of {pull:.3g} m/s^2"
            out.append(Doubt("wheel_turn_in_degrees", f"{text}: this looks like degrees; give radians."))
    return tuple(out)


def _cumulative(where: str, seconds: Array, distances: Array) -> tuple[Doubt, ...]:
    """Distances since the start grow from row to row, as if the vehicle accelerated without end."""
    if len(distances) < LEAST_ROWS:
        return ()
    way = distances * np.sign(distances[-1])
    growth = np.diff(way)
    if not ((growth >= 0).all() and (growth > 0).mean() > 0.5 and (way >= 0).all()):
        return ()
    accelerated = float(np.median(growth / seconds[1:] ** 2))
    if accelerated <= GRIP_M_S2 and way[-1] / seconds[-1] <= FASTEST_M_S:
        return ()
    text = f"{where}: its distances grow from {distances[0]:.4g} to {distances[-1]:.4g} m, from row to row"
    return (
        Doubt(
            "wheel_cumulative", f"{text}: this looks like distances since the start; give those since the row before."
        ),
    )


def still_doubts(where: str, distances: Array, xyz: Array, sigma: Array) -> tuple[Doubt, ...]:
    """Returns a doubt where wheels do not turn while fixes (N, 3), with standard deviations (N, 3), move."""
    if distances.any() or len(xyz) < 2:
        return ()
    moved = float(np.linalg.norm(np.ptp(xyz[:, :2], axis=0)))
    if moved < MOVED_M + MOVED_SIGMAS * float(np.median(sigma)):
        return ()
    text = f"{where}: all {len(distances)} distances are 0, while the GNSS fixes move {moved:.3g} m"
    return (Doubt("wheel_all_zero", f"{text}: check the file's column."),)
