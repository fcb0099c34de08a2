"""Tiny recordings as a user makes them: folders of images, video files, and sequence.yaml."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from ispom.geometry import Pose
from ispom.io.rig import rig_text
from ispom.io.trajectories import tum_text
from ispom.types import Camera, Image, Rig, StereoPair, VideoFrame
from ispom.types import Sequence as Recorded
from tests.sequences.folders import HEIGHT, WIDTH, images

CAMERA = "width: 96\nheight: 64\nfx: 80\nfy: 80\ncx: 47.5\ncy: 31.5\ndistortion: [-0.05, 0.01, 0, 0]\nrate_hz: 20\n"
RAW = Camera(WIDTH, HEIGHT, 80, 80, 47.5, 31.5, (-0.05, 0.01, 0.0, 0.0))
RIG = Rig(
    RAW,
    RAW,
    replace(RAW, fx=81.0),
    Pose.from_rotvec(np.array([0.01, 0, 0]), np.array([0.0, -0.1, 0])),
    Pose(translation=np.array([-0.25, 0, 0])),
    Pose.from_rotvec(np.array([0, 0.01, 0]), np.array([0.25, 0.002, 0])),
)
"""Raw cameras, neither level nor parallel."""
SEQUENCE = """\
name: a test flight
video: {source: video.avi, rate_hz: 20}
left: {source: left, times: left.txt, offset_s: 0.01}
right: {source: right, rate_hz: 10, offset_s: 0.0105}
truth: truth.tum
"""


def in_bgr(image: Image) -> np.ndarray:
    """As OpenCV writes it."""
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR if image.ndim == 2 else cv2.COLOR_RGB2BGR)


def write_images(folder: Path, stream: Sequence[Image]) -> Path:
    """PNG files called 0.png, 1.png, ... 10.png."""
    folder.mkdir(parents=True)
    for i, image in enumerate(stream):
        cv2.imwrite(str(folder / f"{i}.png"), image if image.ndim == 2 else in_bgr(image))
    return folder


def write_video(path: Path, stream: Sequence[Image], rate_hz: float = 20, codec: str = "MJPG") -> Path:
    """A video file, of the best quality of its codec."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = stream[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), rate_hz, (width, height))
    assert writer.isOpened()
    for image in stream:
        writer.write(in_bgr(image))
    writer.release()
    return path


def write_uneven_video(path: Path, stream: Sequence[Image], ticks: Sequence[int]) -> Path:
    """A video file whose images follow at multiples (N,) of 50 ms, as phones write them when light changes."""
    even = write_video(path.with_name(f"even{path.suffix}"), stream)
    packets = cv2.VideoCapture(str(even), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    codec, (height, width) = cv2.VideoWriter.fourcc(*"MJPG"), stream[0].shape[:2]
    options = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, codec, 20, (width, height), options)
    for tick in ticks:
        writer.set(cv2.VIDEOWRITER_PROP_PTS, tick)
        writer.write(packets.read()[1])
    writer.release()
    return path


def make_images(root: Path, frames: int = 6, beside: bool = False) -> Path:
    """A folder of images with camera.yaml in it, or beside it."""
    folder = write_images(root / "shots", images(frames, 0))
    ((root if beside else folder) / "camera.yaml").write_text(CAMERA)
    return folder


def make_video(root: Path, frames: int = 6, name: str = "film.avi", codec: str = "MJPG") -> Path:
    """A video file with film.yaml."""
    path = write_video(root / name, images(frames, 0), 20, codec)
    path.with_suffix(".yaml").write_text(CAMERA)
    return path


def make_described(root: Path, frames: int = 6, video: bool = True) -> Path:
    """A sequence.yaml of a raw three-camera rig: pairs at half the video's rate."""
    pairs = frames // 2 if video else frames
    write_images(root / "left", images(pairs, 8))
    write_images(root / "right", images(pairs, 0))
    (root / "left.txt").write_text("".join(f"{i / 10}\n" for i in range(pairs)))
    (root / "truth.tum").write_text("".join(f"{i / 20} {i / 10} 0 0 0 0 0 1\n" for i in range(2 * frames)))
    (root / "rig.yaml").write_text(rig_text(RIG))
    text = SEQUENCE
    if video:
        write_video(root / "video.avi", images(frames, 0))
    else:
        text = "\n".join(line for line in SEQUENCE.splitlines() if not line.startswith("video"))
    (root / "sequence.yaml").write_text(text)
    return root


def pair_folder(root: Path, frames: int = 6) -> Path:
    """Folders left and right with rig.yaml, and no times."""
    folder = make_described(root, frames, video=False)
    for name in ("sequence.yaml", "left.txt"):
        (folder / name).unlink()
    return folder


def write_sequence(folder: Path, source: Recorded) -> Path:
    """A sequence of three cameras, with ground truth, as a video file, two folders of images and a sequence.yaml."""
    exposures = [source[i] for i in range(len(source))]
    pairs = [e for e in exposures if isinstance(e, StereoPair)]
    assert source.truth is not None
    write_video(folder / "video.avi", [e.image for e in exposures if isinstance(e, VideoFrame)], 30)
    write_images(folder / "left", [pair.left for pair in pairs])
    write_images(folder / "right", [pair.right for pair in pairs])
    (folder / "stereo.txt").write_text("".join(f"{pair.time_ns / 1e9:.9f}\n" for pair in pairs))
    (folder / "rig.yaml").write_text(rig_text(source.rig))
    (folder / "truth.tum").write_text(tum_text(source.truth))
    (folder / "sequence.yaml").write_text(
        "video: video.avi\nleft: {source: left, times: stereo.txt}\nright: {source: right, times: stereo.txt}\n"
        "truth: truth.tum\n"
    )
    return folder


OWN: dict[str, Callable[[Path], Path]] = {
    "images": make_images,
    "images, camera.yaml beside": lambda root: make_images(root, beside=True),
    "video, avi": make_video,
    "video, mp4": lambda root: make_video(root, name="film.mp4", codec="mp4v"),
    "video, mkv": lambda root: make_video(root, name="film.mkv"),
    "sequence.yaml": make_described,
    "sequence.yaml, no video": lambda root: make_described(root, video=False),
}
"""Each writes a recording of six exposures or more below a folder and gives its path."""
