"""A camera that moves past known points and sees them exactly: records as a perfect estimator would leave them."""

from __future__ import annotations

import numpy as np
from ispom_app.engine.history.record import ExposureRecord

from ispom.geometry import Array, Pose
from ispom.types import Camera, Landmarks, Rig, Status, Step, Tracks, TrackStatus

CAMERA = Camera(640, 480, 450.0, 455.0, 322.0, 238.0, (-0.2, 0.05, 0.001, -0.0005))
RIG = Rig.single(CAMERA)
POINTS = np.random.default_rng(3).uniform((-3, -2, 6), (3, 2, 14), (60, 3))
"""(60, 3) in the world; the id of a point is its row."""
COUNT = 10


def pose(i: int) -> Pose:
    """world_from_video at frame i."""
    return Pose.from_rotvec(np.array([0.01, 0.02, -0.01]) * i, np.array([0.3, 0.03, 0.2]) * i)


def seen_from(i: int) -> Array:
    """(60, 2) [px]; NaN where not in the image."""
    uv = CAMERA.project(pose(i).inverse().apply(POINTS))
    inside = ((uv >= 0) & (uv <= (CAMERA.width - 1, CAMERA.height - 1))).all(1)
    return np.where(inside[:, None], uv, np.nan)


def step(i: int, **values: object) -> Step:
    uv, before = seen_from(i), seen_from(i - 1) if i else np.full((60, 2), np.nan)
    now, then = np.isfinite(uv[:, 0]), np.isfinite(before[:, 0])
    ids = np.flatnonzero(now | then)
    status = np.where(now & then, TrackStatus.ALIVE, np.where(now, TrackStatus.NEW, TrackStatus.OUT_OF_IMAGE))[ids]
    tracks = Tracks.of(
        ids,
        np.where(now[:, None], uv, before)[ids],
        uv_prev=before[ids],
        status=status,
        residual_px=np.where(status == TrackStatus.ALIVE, 0.1 + 0.01 * ids, np.nan),
    )
    key = i % 3 == 0
    said = ids[now[ids]] if key else ids[:0]
    points = Landmarks(said, POINTS[said], np.zeros((len(said), 3), np.uint8))
    made = {
        "key_frame": key,
        "tracks": {"video": tracks},
        "landmarks": points,
        "residuals_px": tracks.residual_px[np.isfinite(tracks.residual_px)],
        "method": "monocular",
    }
    return Step(i, Status.TRACKING, "video", pose(i), **made | values)  # type: ignore[arg-type]


def records(**values: object) -> list[ExposureRecord]:
    return [ExposureRecord(i, i, "video", (step(i, **values),), {}, {}, {}) for i in range(COUNT)]
