"""Emulates the paper's platform by a stereo recording: video and stereo frames at different rates."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.sequences.recording import Recording
from ispom.types import Frame, Image, Kind, LaserScanner, Measurement, Rig, Sequence

MIN_SCALE = 0.05
"""Least scale of video images."""
MAX_FRAMES = 10**9
"""Largest number of frames in an option."""


def check_shape(stereo_every: int, video_scale: float) -> None:
    """Raises InputError where an option is out of its range."""
    if not 1 <= stereo_every <= MAX_FRAMES:
        raise InputError(f"--stereo-every is {str(stereo_every)[:40]}, give 1 or more, up to {MAX_FRAMES}")
    if not MIN_SCALE <= video_scale <= 1:
        raise InputError(f"--video-scale is {video_scale:g}, give a value from {MIN_SCALE:g} to 1")


def two_rate(recording: Recording, stereo_every: int = 1, video_scale: float = 1.0) -> Sequence:
    """Returns a sequence with every left image, scaled, as video, and every k-th pair, at full resolution, as stereo.

    A stereo frame comes just before the video frame of the same time. Without a right camera there is video only.
    Raises InputError where an option is out of its range.
    """
    check_shape(stereo_every, video_scale)
    video = recording.camera.scaled(video_scale)
    rig, notes = Rig.single(video), recording.notes
    guess = recording.guess and replace(recording.guess, focal_px=video.fx * recording.guess.aspect)
    if guess is not None:
        notes = (guess.note, *notes)
    if recording.baseline_m is not None:
        stereo = Rig.stereo(recording.camera, recording.baseline_m)
        rig = stereo.changed(video=video, rig_from_video=stereo.rig_from_left)
        notes = (_emulation(stereo_every, video_scale), *notes)
    if recording.left_from_laser is not None:
        rig = rig.changed(laser=LaserScanner(rig_from_sensor=rig.rig_from_left @ recording.left_from_laser))
    rig = rig.changed(video_sigma=recording.video_sigma, pair_sigma=recording.pair_sigma)
    plan: list[tuple[int, Kind]] = []
    for i in range(len(recording.times_ns)):
        if rig.has_stereo and i % stereo_every == 0:
            plan.append((i, "stereo"))
        plan.append((i, "video"))

    @lru_cache(maxsize=1)  # the left image of a pair is also the next video frame
    def left(i: int) -> Image:
        return recording.read("left", i)

    def load(index: int) -> Measurement:
        i, kind = plan[index]
        time_ns = int(recording.times_ns[i])
        if kind == "stereo":
            return Frame.stereo(time_ns, left(i), recording.read("right", i))
        image = left(i)
        if (video.width, video.height) != (recording.camera.width, recording.camera.height):
            image = cv2.resize(image, (video.width, video.height), interpolation=cv2.INTER_AREA)
        return Frame.video(time_ns, np.asarray(image, np.uint8))

    times_ns = recording.times_ns[[i for i, _ in plan]]
    truth = recording.truth and recording.truth.moved(right=rig.rig_from_video.inverse(), frame="rig")
    kinds = tuple(kind for _, kind in plan)
    return Sequence(recording.name, rig, times_ns, kinds, load, truth, notes, guess=guess).with_found(recording.found)


def _emulation(stereo_every: int, video_scale: float) -> str:
    pairs = "every pair" if stereo_every == 1 else f"one pair in {stereo_every}"
    size = {1.0: "full size", 0.5: "half size"}.get(video_scale, f"{video_scale:g} of its size")
    return f"Emulated from a stereo recording: video = left image, {size}; stereo = {pairs}."
