"""A sequence whose images are known: grey 128 with a bright square, that moves by a pixel from frame to frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.types import Frame, Image, Measurement, Sequence, is_stereo, is_video
from tests import doubles


def still_life(height: int, width: int, shift: int) -> Image:
    image = np.full((height, width, 3), 128, np.uint8)
    image[20:40, 20 + shift : 40 + shift] = 200
    return image


@pytest.fixture
def plain() -> Sequence:
    """60 video frames, 7 pairs."""
    given = doubles.sequence(60)

    def load(i: int) -> Measurement:
        time_ns = int(given.times_ns[i])
        if given.kinds[i] == "video":
            return Frame.video(time_ns, still_life(60, 80, i % 7))
        return Frame.stereo(time_ns, still_life(120, 160, i % 7), still_life(120, 160, i % 7 + 5))

    return replace(given, load=load)


def video(sequence: Sequence, nth: int) -> Frame:
    found = sequence[[i for i, kind in enumerate(sequence.kinds) if kind == "video"][nth]]
    assert is_video(found)
    return found


def pair(sequence: Sequence, nth: int) -> Frame:
    found = sequence[[i for i, kind in enumerate(sequence.kinds) if kind == "stereo"][nth]]
    assert is_stereo(found)
    return found
