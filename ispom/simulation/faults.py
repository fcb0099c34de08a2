"""Faults put into a sequence on purpose: what an estimator that refines the rig must find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.geometry import Array, Pose
from ispom.types import Exposure, Sequence, Trajectory, VideoFrame


def with_late_video(sequence: Sequence, late_s: float) -> Sequence:
    """As `with_video_clock`, without drift, and named so."""
    return replace(with_video_clock(sequence, late_s), name=f"{sequence.name}, video {1e3 * late_s:g} ms late")


def with_video_clock(sequence: Sequence, late_s: float, drift: float = 0.0) -> Sequence:
    """The video camera exposes `late_s` [s] after what its time stamps say, and `drift` of the time since the first
    exposure more; negative: before.

    Stamps, and with them the order of the exposures, change; the truth is stamped like what it is the truth of.
    """
    since_ns = sequence.times_ns - sequence.times_ns[0]
    shift_ns = round(late_s * 1e9) + np.rint(drift * since_ns).astype(np.int64)
    video = np.array([kind == "video" for kind in sequence.kinds])
    times_ns = sequence.times_ns - np.where(video, shift_ns, 0)
    # A stereo pair comes before the video frame of the same time.
    order = np.lexsort((video, times_ns))

    def load(i: int) -> Exposure:
        exposure = sequence.load(int(order[i]))
        return replace(exposure, time_ns=int(times_ns[order[i]])) if isinstance(exposure, VideoFrame) else exposure

    truth = sequence.truth
    if truth is not None:
        stamps = zip(times_ns, sequence.times_ns, strict=True)
        truth = Trajectory.of([(int(t), pose) for t, was in stamps if (pose := truth.at(int(was))) is not None])
    return replace(
        sequence,
        times_ns=times_ns[order],
        kinds=tuple(sequence.kinds[i] for i in order),
        load=load,
        truth=truth,
        prepare=None,
    )


def with_turned_video(sequence: Sequence, turn_deg: Array) -> Sequence:
    """The rig is told with its video camera turned by a rotation vector (3,) [deg] about the camera's axes."""
    rig = sequence.rig
    turned = rig.rig_from_video @ Pose.from_rotvec(np.radians(turn_deg), np.zeros(3))
    return replace(sequence, name=f"{sequence.name}, rig turned", rig=replace(rig, rig_from_video=turned))
