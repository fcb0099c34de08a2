"""Where the simulated platform is at any time: a smooth flight along the street, with the shake of a hand on top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.geometry import Array, Pose, so3_exp

SHAKE_M = np.array([0.013, 0.015, 0.008])
"""Amplitude of each of the shake's sinusoids in x, y, z: about 3 cm peak in all."""
SHAKE_DEG = np.array([0.55, 0.65, 0.5])
"""The same about x, y, z: 1-2 degrees in all."""


@dataclass(frozen=True, eq=False)
class Path:
    """world_from_rig as an analytic function of time. World: x right, y down, z along the street, ground at y = 0."""

    speed_m_s: float
    """Mean speed along the street."""
    sway: Array
    """(4, 3) amplitude [m], frequency [Hz], phase [rad] of the slow motion: x, y, z, and extra yaw [rad]."""
    shake_hz: Array
    """(6, 3) frequencies of the shake, 1-4 Hz: x, y, z, rotation about x, y, z."""
    shake_phase: Array
    """(6, 3) [rad]."""

    @staticmethod
    def seeded(seed: int) -> Path:
        """A path whose bends and shake depend on the seed, and that stays within the free part of the street."""
        rng = np.random.default_rng([seed, 1])
        frequency = np.array([1 / 11.5, 1 / 8.5, 1 / 7.0, 1 / 6.0]) * rng.uniform(0.92, 1.08, 4)
        sway = np.stack([[2.0, 0.55, 0.25, np.radians(5)], frequency, rng.uniform(0, 2 * np.pi, 4)], axis=1)
        hz = np.sort(rng.uniform((1.0, 1.8, 2.8), (1.8, 2.8, 4.0), (6, 3)), axis=1)
        return Path(1.45, sway, hz, rng.uniform(0, 2 * np.pi, (6, 3)))

    def pose_at(self, time_ns: int) -> Pose:
        """world_from_rig at a time [ns]."""
        t = time_ns * 1e-9
        amplitude, omega = self.sway[:, 0], 2 * np.pi * self.sway[:, 1]
        wave = amplitude * np.sin(omega * t + self.sway[:, 2])
        slope = amplitude * omega * np.cos(omega * t + self.sway[:, 2])
        position = np.array([wave[0], -1.75 + wave[1], self.speed_m_s * t + wave[2]])
        forward = self.speed_m_s + slope[2]
        yaw = 0.8 * np.arctan2(slope[0], forward) + wave[3]
        pitch = -0.7 * np.arctan2(slope[1], forward)
        roll = -0.12 * wave[0] * omega[0] ** 2 * 2  # leans into bends
        shake = np.sin(2 * np.pi * self.shake_hz * t + self.shake_phase).sum(axis=1)
        smooth = so3_exp(np.array([0, yaw, 0])) @ so3_exp(np.array([pitch, 0, 0])) @ so3_exp(np.array([0, 0, roll]))
        return Pose(smooth @ so3_exp(np.radians(SHAKE_DEG) * shake[3:]), position + smooth @ (SHAKE_M * shake[:3]))
