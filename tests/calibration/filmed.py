"""A filmed session without pictures: what the three cameras see of a target while the rig moves, for the tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.calibration.result import Views
from ispom.calibration.targets.target import Target
from ispom.geometry import Array, Pose
from ispom.simulation.filmed_board import Filming
from tests.calibration.corners import NOISE_PX, seen_by, views_of

FIRST_S = 0.2113


def filmed(
    target: Target, film: Filming, seed: int, pairs_s: Array, video_s: Array, noise_px: float = NOISE_PX
) -> tuple[Views, Views, Views]:
    """Left, right and video, exposed at these true times [s]."""
    rig, rng = film.rig, np.random.default_rng(seed)
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    poses = [film.left_from_board_at(t) for t in pairs_s]
    own = [film.video_from_board_at(t + film.clock_offset_s) for t in video_s]
    out = []
    for name, at_s, seen in (
        ("left", pairs_s, poses),
        ("right", pairs_s, [right_from_left @ pose for pose in poses]),
        ("video", video_s + film.clock_offset_s, own),
    ):
        camera = rig.camera(name)  # type: ignore[arg-type]
        detections = seen_by(target, camera, seen, rng, noise_px)
        out.append(replace(views_of(name, camera, detections), times_ns=np.rint(at_s * 1e9).astype(np.int64)))
    return out[0], out[1], out[2]


def around(pairs_s: Array, interval_s: float, each_side: int) -> Array:
    """Times of the video at its rate, of which only those next to the pairs are kept."""
    index = np.floor(pairs_s / interval_s).astype(int)[:, None] + np.arange(1 - each_side, 1 + each_side)
    return np.unique(index[index >= 0]) * interval_s


def video_from_left(film: Filming) -> Pose:
    """The truth."""
    return film.rig.rig_from_video.inverse() @ film.rig.rig_from_left
