"""360-degree images as a rig of pinhole cameras with one centre: the four upright sides of a cube around it.

`multicamera` steps on all four; a method of one camera on the front one, which
is the video camera, too. What is right above and below is in none of them: there are the sky and the platform itself.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras import EQUIRECTANGULAR, resampling
from ispom.geometry import Pose, so3_exp
from ispom.types import Camera, CameraSensor, Frame, Image, Kind, Measurement, Sequence, is_video

FACES = {"front": 0.0, "right90": 90.0, "back": 180.0, "left90": 270.0}
"""By name: by how much a face is turned to the right [degrees]. Names of a pair would make it one."""
NOTE = (
    "Its 360-degree images are used as four pinhole views from one centre: a method of one camera uses the front one, "
    "multicamera all four. One centre never shows the scale."
)


def with_faces(sequence: Sequence) -> Sequence:
    """Returns the sequence with the faces of its video camera's 360-degree images; unchanged where it is another
    camera."""
    panorama = sequence.rig.video
    if panorama is None or panorama.lens != EQUIRECTANGULAR.name:
        return sequence
    face = face_of(panorama)
    turns = {name: so3_exp(np.array([0.0, np.radians(degrees), 0.0])) for name, degrees in FACES.items()}
    maps = {name: resampling(panorama, face, turn) for name, turn in turns.items()}
    rig_from_video = sequence.rig.rig_from_video
    sensors = {
        name: CameraSensor(camera=face, rig_from_sensor=rig_from_video @ Pose(turn)) for name, turn in turns.items()
    }
    rig = sequence.rig.changed(video=face, **sensors)
    plan: list[tuple[int, Kind]] = []
    for i, kind in enumerate(sequence.kinds):
        plan += [(i, "cameras"), (i, kind)] if kind == "video" else [(i, kind)]

    @lru_cache(maxsize=1)  # both frames of a time have the front
    def faces(i: int) -> tuple[int, dict[str, Image]]:
        frame = sequence.load(i)
        if not is_video(frame):
            raise ValueError(f"measurement {i} is no video frame")
        return frame.time_ns, {name: _remapped(frame.image, each) for name, each in maps.items()}

    def load(index: int) -> Measurement:
        i, kind = plan[index]
        if sequence.kinds[i] != "video":
            return sequence.load(i)
        time_ns, images = faces(i)
        return Frame(time_ns, images) if kind == "cameras" else Frame.video(time_ns, images["front"])

    return replace(
        sequence,
        rig=rig,
        times_ns=sequence.times_ns[[i for i, _ in plan]],
        kinds=tuple(kind for _, kind in plan),
        load=load,
        notes=(*sequence.notes, NOTE),
    )


def face_of(panorama: Camera) -> Camera:
    """Returns the camera of a face, 90 by 90 degrees, whose middle has the resolution of the panorama."""
    side = 2 * round(panorama.fx)
    return Camera(side, side, side / 2, side / 2, (side - 1) / 2, (side - 1) / 2)


def _remapped(image: Image, maps: tuple[NDArray, NDArray]) -> Image:
    """Returns a face, read-only; the image goes on from its right side at its left one."""
    face = np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint8)
    face.setflags(write=False)
    return face
