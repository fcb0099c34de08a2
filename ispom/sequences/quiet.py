"""Decoders that write to standard error about what they meet, told to be silent: the one sentence is ours."""

from __future__ import annotations

import os

import cv2


def quiet_decoders() -> None:
    """From the first use of FFmpeg on, unless the person asks it for more by OPENCV_FFMPEG_LOGLEVEL."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
