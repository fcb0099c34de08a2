"""How late the clock of the IMU is, by the rotations of the images between the nodes of `fused`."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ispom.evaluation.sensors.gyroscope import FEWEST, LATEST_S, Turns, gyroscope_fit
from ispom.evaluation.sensors.intervals import LENGTHS_S, length_s
from ispom.geometry import Array, Pose, so3_log
from ispom.sensors.fusion import Node
from ispom.sensors.imu import inertial_of
from ispom.types import ClockOffset

EVERY = 40
"""Nodes from one estimate to the next: the clock does not change, and a fit takes as long as several nodes."""
MOST = 240
"""Nodes that are looked at, a minute of them: clocks drift by milliseconds in a minute at most."""


def clock_due(node: Node) -> bool:
    """Checks that it is time for an estimate."""
    return node.number > 0 and node.number % EVERY == 0


def imu_clock(nodes: Iterable[Node], camera_from_rig: Pose, rig_from_imu: Pose) -> ClockOffset | None:
    """Returns the delay of the IMU's time stamps; None where the motion shows none yet."""
    chain = _unbroken(list(nodes)[-MOST:])
    samples = [inertial_of(node) for node in chain[1:]]
    if not chain or not samples:
        return None
    seconds = np.concatenate([each.seconds for each in samples if each is not None])
    rates = np.concatenate([each.rates for each in samples if each is not None])
    times = np.append(0.0, np.cumsum(seconds))
    angle = np.vstack([np.zeros((1, 3)), np.cumsum(rates * seconds[:, None], axis=0)])
    _, noise = length_s(times[1:], rates)
    at = np.array([(node.time_ns - chain[0].time_ns) * 1e-9 for node in chain])
    rotations = np.array([_rotation(node, camera_from_rig) for node in chain])
    turned = so3_log(np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:])
    # Shifted intervals stay within the measured time.
    inside = (at[:-1] >= LATEST_S) & (at[1:] <= at[-1] - LATEST_S)
    if inside.sum() < FEWEST:
        return None
    begins, ends = at[:-1][inside], at[1:][inside]
    apart = float(np.median(ends - begins)) <= LENGTHS_S[1]
    found = gyroscope_fit(Turns(begins, ends, turned[inside], times, angle, rig_from_imu.rotation, noise, apart))
    if not found.turns.clock_shows:
        return None
    return ClockOffset(float(found.fit.values[0]), float(found.fit.sigmas[0]))


def _rotation(node: Node, camera_from_rig: Pose) -> Array:
    assert node.camera is not None
    return node.camera.rotation @ camera_from_rig.rotation


def _unbroken(nodes: list[Node]) -> list[Node]:
    """Returns the last nodes between which images and IMU measured all the time."""
    for i in range(len(nodes) - 1, -1, -1):
        node = nodes[i]
        if node.camera is None:
            return nodes[i + 1 :]
        if node.fresh or node.visual is None or inertial_of(node) is None:
            return nodes[i:]
    return nodes
