"""Faults put into a sequence on purpose: what an estimator that refines the rig must find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.geometry import Array, Pose
from ispom.types import Sequence


def with_late_video(sequence: Sequence, late_s: float) -> Sequence:
    """As `with_video_clock`, without drift, and named so."""
    return replace(with_video_clock(sequence, late_s), name=f"{sequence.name}, video {1e3 * late_s:g} ms late")


def with_video_clock(sequence: Sequence, late_s: float, drift: float = 0.0) -> Sequence:
    """The video camera exposes `late_s` [s] after what its time stamps say, and `drift` of the time since the first
    exposure more; negative: before.

    Stamps, and with them the order of the exposures, change; the truth is stamped like what it is the truth of.
    """
    return sequence.with_video_later(-late_s, -drift)


def with_turned_video(sequence: Sequence, turn_deg: Array) -> Sequence:
    """The rig is told with its video camera turned by a rotation vector (3,) [deg] about the camera's axes."""
    rig = sequence.rig
    turned = rig.rig_from_video @ Pose.from_rotvec(np.radians(turn_deg), np.zeros(3))
    return replace(sequence, name=f"{sequence.name}, rig turned", rig=rig.changed(rig_from_video=turned))
