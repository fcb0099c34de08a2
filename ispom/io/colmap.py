"""COLMAP's text model: cameras.txt, images.txt and points3D.txt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.cameras import require_opencv
from ispom.errors import InputError
from ispom.geometry import Array
from ispom.io.calibrations.placed import Placed, camera_from
from ispom.io.maps import SceneMap
from ispom.io.rows import numbers, read_text
from ispom.types import Camera

CORNER_ORIGIN_PX = 0.5
"""COLMAP's coordinates of the top-left pixel's centre, which is (0, 0) here: its (0, 0) is that pixel's corner."""


@dataclass(frozen=True)
class ColmapModel:
    """The three text files of a COLMAP model."""

    cameras: str
    """Content of cameras.txt."""
    images: str
    """Content of images.txt."""
    points: str
    """Content of points3D.txt."""
    kept: int
    """Number of observations in the model, which are those of landmarks with at least two images."""
    observations: int
    """Number of all observations."""
    point_count: int
    mean_error_px: float | None
    """Mean reprojection error of the observations in the model; None without any."""


def colmap_model(scene: SceneMap, camera: Camera, max_error_px: float) -> ColmapModel:
    """Returns the model of one method: its keyframes as images called CAMERA/TIME_NS.png, its landmarks as points.

    An observation is in the model if its reprojection error is at most max_error_px, a landmark if it has two of them
    or more. `camera` is that of the keyframes; poses are not optimised again.
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
        cameras=f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n{camera_line(camera)}\n",
        images=_images(scene, uv, landmarks.ids[row], starts),
        points=_points(scene, row, frame, np.arange(len(row)) - starts[frame], error_px),
        kept=len(row),
        observations=int(known.sum()),
        point_count=len(np.unique(row)),
        mean_error_px=float(error_px.mean()) if len(row) else None,
    )


def _errors(
    scene: SceneMap, camera: Camera, row: NDArray[np.intp], frame: NDArray[np.int64], uv: Array
) -> NDArray[np.float64]:
    """Returns reprojection errors (N,) [px]; infinite behind the camera."""
    seen = scene.landmarks.xyz_in_world[row] - scene.key_frames.translations[frame]
    in_camera = np.einsum("nji,nj->ni", scene.key_frames.rotations[frame], seen)
    return np.nan_to_num(np.linalg.norm(camera.project(in_camera) - uv, axis=1), nan=np.inf)


def camera_line(camera: Camera, number: int = 1) -> str:
    """Returns the camera's line of cameras.txt: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[].

    OpenCV's distortion has the same order of coefficients there; models differ in their number.
    """
    require_opencv(camera, "COLMAP")
    model, count = {0: ("PINHOLE", 0), 4: ("OPENCV", 4)}.get(len(camera.distortion), ("FULL_OPENCV", 8))
    if camera.lens == "fisheye":
        model, count = "OPENCV_FISHEYE", 4
    distortion = (*camera.distortion, *([0.0] * 8))[:count]
    values = (camera.fx, camera.fy, camera.cx + CORNER_ORIGIN_PX, camera.cy + CORNER_ORIGIN_PX, *distortion)
    return f"{number} {model} {camera.width} {camera.height} {' '.join(repr(float(v)) for v in values)}"


def _images(scene: SceneMap, uv: Array, ids: NDArray[np.int64], starts: NDArray[np.intp]) -> str:
    """Returns two lines for each image: camera_from_world and name; then its observations."""
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as X, Y, POINT3D_ID"]
    for k, (time_ns, pose) in enumerate(scene.key_frames.items()):
        camera_from_world = pose.inverse()
        values = " ".join(repr(float(v)) for v in (*camera_from_world.wxyz, *camera_from_world.translation))
        here = slice(starts[k], starts[k + 1])
        seen = zip((uv[here] + CORNER_ORIGIN_PX).tolist(), ids[here].tolist(), strict=True)
        lines.append(f"{k + 1} {values} 1 {scene.key_frames.frame}/{time_ns}.png")
        lines.append(" ".join(f"{u:.4f} {v:.4f} {i}" for (u, v), i in seen))
    return "\n".join(lines) + "\n"


def _points(
    scene: SceneMap, row: NDArray[np.intp], frame: NDArray[np.int64], place: NDArray[np.intp], error_px: Array
) -> str:
    """Writes the points; `place` is each observation's index within its image."""
    lines = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as IMAGE_ID, POINT2D_IDX"]
    order = np.argsort(row, kind="stable")
    points, first = np.unique(row[order], return_index=True)
    for point, seen in zip(points.tolist(), np.split(order, first[1:]), strict=False):
        xyz = " ".join(repr(float(v)) for v in scene.landmarks.xyz_in_world[point])
        rgb = " ".join(str(v) for v in scene.landmarks.rgb[point].tolist())
        track = " ".join(f"{frame[n] + 1} {place[n]}" for n in seen)
        lines.append(f"{scene.landmarks.ids[point]} {xyz} {rgb} {error_px[seen].mean():.4f} {track}")
    return "\n".join(lines) + "\n"


# COLMAP's cameras.txt: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]; it has no poses.


COUNTS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8, "FULL_OPENCV": 12}
COUNTS |= {"OPENCV_FISHEYE": 8, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL_FISHEYE": 5, "SIMPLE_FISHEYE": 3, "FISHEYE": 4}
"""Numbers of parameters of the models that are supported."""
_ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE")


def colmap_cameras_text(cameras: list[Placed]) -> str:
    """Writes cameras with numbers from 1 on."""
    lines = [camera_line(each.camera, n) for n, each in enumerate(cameras, 1)]
    return "\n".join(["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]", *lines]) + "\n"


def read_colmap_cameras(path: Path) -> list[Camera]:
    """Reads cameras in the order of the file. Raises InputError that names the invalid line."""
    out = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) < 4:
            raise InputError(f"{path} line {number}: CAMERA_ID, MODEL, WIDTH and HEIGHT are needed: correct that line")
        values = [] if words[1] not in COUNTS else numbers(path, number, words[2:]).tolist()
        out.append(colmap_camera(path, f"line {number}", words[1], values))
    if not out:
        raise InputError(f"{path} holds no camera: give COLMAP's cameras.txt")
    return out


def colmap_camera(path: Path, where: str, model: str, values: list[float]) -> Camera:
    """Returns the camera of a model's name, and of width, height and the parameters. Raises InputError for a model that
    is not supported, and for a wrong number of parameters."""
    if model not in COUNTS:
        raise InputError(
            f"{path}: {where}: a file of COLMAP: the model {model[:40]} is not supported: use one of "
            f"{', '.join(COUNTS)}"
        )
    if len(values) != 2 + COUNTS[model]:
        raise InputError(f"{path}: {where}: {model} has {COUNTS[model]} parameters, not {len(values) - 2}: correct it")
    size, rest = values[:2], values[2:]
    focals = [rest[0], rest[0]] if model in _ONE_FOCAL else rest[:2]
    rest = rest[1:] if model in _ONE_FOCAL else rest[2:]
    centre, distortion = [v - CORNER_ORIGIN_PX for v in rest[:2]], rest[2:]
    if model in ("SIMPLE_RADIAL", "RADIAL"):
        distortion = [*distortion, 0.0][:2]
        distortion = [*distortion, 0.0, 0.0]
    lens = "fisheye" if "FISHEYE" in model else "opencv"
    if lens == "fisheye":
        distortion = [*distortion, 0.0, 0.0, 0.0, 0.0][:4]
    return camera_from(path, where, np.array(size), [*focals, *centre], distortion, lens)
