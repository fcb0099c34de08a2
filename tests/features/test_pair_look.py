"""What is mixed up in a pair is told, and nothing where it is right, or where nothing can be told."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.features.pair_look import EXCHANGED, SAME, SIDE_BY_SIDE, halves_note, pair_note, with_look
from ispom.types import Camera, Frame, Image, Measurement, Rig, Sequence

WIDTH, HEIGHT = 480, 320
RNG = np.random.default_rng(4)
TEXTURE = cv2.resize(RNG.integers(0, 256, (HEIGHT // 4, WIDTH // 4 + 30), np.uint8), (WIDTH + 120, HEIGHT))


def pair(time_ns: int = 0, lower_px: float = 0.0) -> Frame:
    """Of a ground that is nearer farther down: 4 to 40 px of disparity."""
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    disparity = 4 + 36 * y / HEIGHT
    left = cv2.remap(TEXTURE, x + 20, y, cv2.INTER_LINEAR)
    right = cv2.remap(TEXTURE, x + 20 + disparity, y - np.float32(lower_px), cv2.INTER_LINEAR)
    return Frame.stereo(time_ns, np.asarray(left, np.uint8), np.asarray(right, np.uint8))


def turned(a: Image, b: Image) -> Frame:
    return Frame.stereo(0, a, b)


def test_a_right_pair_is_not_spoken_of() -> None:
    assert pair_note([pair()]) == pair_note([pair(lower_px=1.0)]) == pair_note([pair(lower_px=-3.0)]) == ""


def test_exchanged_images_are_told() -> None:
    right_way = pair()
    assert pair_note([turned(right_way.right, right_way.left)]) == EXCHANGED


def test_one_camera_given_twice_is_told() -> None:
    left = pair().left
    assert pair_note([turned(left, left)]) == SAME


@pytest.mark.parametrize(("lower_px", "words"), [(6.0, "6.0 px lower"), (-8.0, "8.0 px higher")])
def test_rows_that_are_far_off_are_told(lower_px: float, words: str) -> None:
    assert words in pair_note([pair(lower_px=lower_px)])
    assert pair_note([pair(lower_px=lower_px)], px_per_tracked=4.0) == ""


def test_what_cannot_be_told_is_not_told() -> None:
    other = np.asarray(cv2.GaussianBlur(RNG.integers(0, 256, (HEIGHT, WIDTH), np.uint8), (0, 0), 2), np.uint8)
    black = np.zeros((HEIGHT, WIDTH), np.uint8)
    for image in (other, black):
        assert pair_note([turned(pair().left, image)]) == ""
    assert pair_note([turned(black, black)]) == pair_note([]) == ""


def test_the_note_stands_with_the_others_of_a_sequence() -> None:
    def load(i: int) -> Measurement:
        return turned(pair().right, pair().left)

    def broken(i: int) -> Measurement:
        raise InputError("the file is gone")

    rig = Rig.stereo(Camera(WIDTH, HEIGHT, 400, 400, 240, 160), 0.2)
    times_ns = np.arange(3, dtype=np.int64)
    sequence = Sequence("a pair", rig, times_ns, ("stereo",) * 3, load, notes=("first",))
    assert with_look(sequence).notes == ("first", EXCHANGED)
    assert with_look(replace(sequence, load=broken)).notes == ("first",)
    assert with_look(replace(sequence, grow=lambda i, s: sequence)).notes == ("first",)
    assert with_look(replace(sequence, rig=Rig.single(rig.camera("left")))).notes == ("first",)


def test_images_side_by_side_are_told() -> None:
    beside = np.hstack([pair().left, pair(lower_px=12).right])  # as filmed, not rectified
    colours = np.dstack([beside] * 3)
    assert halves_note([beside, beside]) == halves_note([colours]) == SIDE_BY_SIDE
    assert halves_note([pair().left, beside]) == halves_note([pair().left[:, :40]]) == halves_note([]) == ""

    def load(i: int) -> Measurement:
        return Frame.video(i, beside)

    rig = Rig.single(Camera(2 * WIDTH, HEIGHT, 400, 400, 480, 160))
    sequence = Sequence("a film", rig, np.arange(3, dtype=np.int64), ("video",) * 3, load, notes=("first",))
    assert with_look(sequence).notes == ("first", SIDE_BY_SIDE)
