"""COLMAP's text model: cameras.txt, images.txt and points3D.txt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.cameras import require_opencv
from ispom.geometry import Array
from ispom.io.maps import SceneMap
from ispom.types import Camera

PIXEL = 0.5
"""COLMAP's pixel (0, 0) is the corner of the top-left pixel, ours its centre."""


@dataclass(frozen=True)
class ColmapModel:
    cameras: str
    """The content of cameras.txt, and so on."""
    images: str
    points: str
    kept: int
    """Observations in the model, and of how many: those of landmarks that at least two images saw."""
    observations: int
    point_count: int
    mean_error_px: float | None
    """Reprojection error of those kept; None without any."""


def colmap_model(scene: SceneMap, camera: Camera, max_error_px: float) -> ColmapModel:
    """The model of one method: its key frames as images called CAMERA/TIME_NS.png, its landmarks as points.

    An observation counts where its landmark is reprojected within max_error_px, a landmark with two of them or more.
    `camera` is that of the key frames; errors are of their poses, as they are.
    """
    landmarks, keys = scene.landmarks, scene.key_frames
    row = np.searchsorted(landmarks.ids, scene.seen_ids).clip(0, max(len(landmarks) - 1, 0))
    known = landmarks.ids[row] == scene.seen_ids if len(landmarks) else np.zeros(len(row), bool)
    known[known] = (np.bincount(row[known], minlength=len(landmarks)) >= 2)[row[known]]
    row, frame, uv = row[known], scene.seen_from[known], scene.seen_uv[known].astype(float)
    error_px = _errors(scene, camera, row, frame, uv)
    good = error_px <= max_error_px
    good &= (np.bincount(row[good], minlength=len(landmarks)) >= 2)[row]
    row, frame, uv, error_px = row[good], frame[good], uv[good], error_px[good]
    order = np.argsort(frame, kind="stable")
    row, frame, uv, error_px = row[order], frame[order], uv[order], error_px[order]
    starts = np.searchsorted(frame, np.arange(len(keys) + 1))
    return ColmapModel(
        f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n{camera_line(camera)}\n",
        _images(scene, uv, landmarks.ids[row], starts),
        _points(scene, row, frame, np.arange(len(row)) - starts[frame], error_px),
        len(row),
        int(known.sum()),
        len(np.unique(row)),
        float(error_px.mean()) if len(row) else None,
    )


def _errors(
    scene: SceneMap, camera: Camera, row: NDArray[np.intp], frame: NDArray[np.int64], uv: Array
) -> NDArray[np.float64]:
    """(N,) [px]; infinite behind the camera."""
    seen = scene.landmarks.xyz_in_world[row] - scene.key_frames.translations[frame]
    in_camera = np.einsum("nji,nj->ni", scene.key_frames.rotations[frame], seen)
    return np.nan_to_num(np.linalg.norm(camera.project(in_camera) - uv, axis=1), nan=np.inf)


def camera_line(camera: Camera, number: int = 1) -> str:
    """The camera's line of cameras.txt: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[].

    OpenCV's distortion has the same order of coefficients there; models differ by how many they have.
    """
    require_opencv(camera, "COLMAP")
    model, count = {0: ("PINHOLE", 0), 4: ("OPENCV", 4)}.get(len(camera.distortion), ("FULL_OPENCV", 8))
    if camera.lens == "fisheye":
        model, count = "OPENCV_FISHEYE", 4
    distortion = (*camera.distortion, *([0.0] * 8))[:count]
    values = (camera.fx, camera.fy, camera.cx + PIXEL, camera.cy + PIXEL, *distortion)
    return f"{number} {model} {camera.width} {camera.height} {' '.join(repr(float(v)) for v in values)}"


def _images(scene: SceneMap, uv: Array, ids: NDArray[np.int64], starts: NDArray[np.intp]) -> str:
    """Two lines each: camera_from_world and name; then what it saw."""
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as X, Y, POINT3D_ID"]
    for k, (time_ns, pose) in enumerate(scene.key_frames.items()):
        camera_from_world = pose.inverse()
        values = " ".join(repr(float(v)) for v in (*camera_from_world.wxyz, *camera_from_world.translation))
        here = slice(starts[k], starts[k + 1])
        seen = zip((uv[here] + PIXEL).tolist(), ids[here].tolist(), strict=True)
        lines.append(f"{k + 1} {values} 1 {scene.key_frames.frame}/{time_ns}.png")
        lines.append(" ".join(f"{u:.4f} {v:.4f} {i}" for (u, v), i in seen))
    return "\n".join(lines) + "\n"


def _points(
    scene: SceneMap, row: NDArray[np.intp], frame: NDArray[np.int64], place: NDArray[np.intp], error_px: Array
) -> str:
    """`place` is each observation's index within its image."""
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX"]
    order = np.argsort(row, kind="stable")
    points, first = np.unique(row[order], return_index=True)
    for point, seen in zip(points.tolist(), np.split(order, first[1:]), strict=False):
        xyz = " ".join(repr(float(v)) for v in scene.landmarks.xyz_in_world[point])
        rgb = " ".join(str(v) for v in scene.landmarks.rgb[point].tolist())
        track = " ".join(f"{frame[n] + 1} {place[n]}" for n in seen)
        lines.append(f"{scene.landmarks.ids[point]} {xyz} {rgb} {error_px[seen].mean():.4f} {track}")
    return "\n".join(lines) + "\n"
