"""What is mixed up in a pair is told, and nothing where it is right, or where nothing can be told."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.features.pair_look import (
    EXCHANGED,
    MIRRORED,
    MIRRORED_UPSIDE,
    ONE_ABOVE_OTHER,
    SAME,
    SIDE_BY_SIDE,
    UPSIDE,
    halves_note,
    moments_note,
    pair_note,
    with_look,
)
from ispom.features.pair_rows import LEVELLED_PX, Look
from ispom.plausibility.doubt import keys_of
from ispom.types import Camera, Frame, Image, Measurement, Rig, Sequence

WIDTH, HEIGHT = 480, 320
RNG = np.random.default_rng(4)
TEXTURE = cv2.resize(RNG.integers(0, 256, (HEIGHT // 4, WIDTH // 4 + 30), np.uint8), (WIDTH + 120, HEIGHT))


def pair(time_ns: int = 0, lower_px: float = 0.0, texture: np.ndarray = TEXTURE) -> Frame:
    """Of a ground that is nearer farther down: 4 to 40 px of disparity."""
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    disparity = 4 + 36 * y / HEIGHT
    left = cv2.remap(texture, x + 20, y, cv2.INTER_LINEAR)
    right = cv2.remap(texture, x + 20 + disparity, y - np.float32(lower_px), cv2.INTER_LINEAR)
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
    note = pair_note([pair(lower_px=lower_px)])
    assert words in note and f"{LEVELLED_PX:g} px" in note
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
    assert with_look(sequence).notes == ("first", EXCHANGED) and keys_of(with_look(sequence).notes) == {"pair_unlike"}
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


def test_images_one_above_the_other_are_told() -> None:
    above = np.vstack([pair().left, pair(lower_px=5).right])
    assert halves_note([above]) == ONE_ABOVE_OTHER


@pytest.mark.parametrize("degrees", [1.5, -2.0])
def test_a_right_camera_that_is_turned_is_told(degrees: float) -> None:
    right = pair()
    turn = cv2.getRotationMatrix2D(((WIDTH - 1) / 2, (HEIGHT - 1) / 2), -degrees, 1)
    image = np.asarray(cv2.warpAffine(right.right, turn, (WIDTH, HEIGHT)), np.uint8)
    note = pair_note([turned(right.left, image)])
    assert f"{abs(degrees):.2g} degrees {'clockwise' if degrees > 0 else 'anticlockwise'}" in note


def test_right_images_that_are_upside_down_or_mirrored_are_told() -> None:
    both = pair()
    for flipped, note in (
        (both.right[::-1, ::-1], UPSIDE),
        (both.right[:, ::-1], MIRRORED),
        (both.right[::-1], MIRRORED_UPSIDE),
    ):
        assert pair_note([turned(both.left, np.ascontiguousarray(flipped))]) == note


def moving(i: int) -> Frame:
    """The ground as it rolls, and sinks unevenly."""
    turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), 1.5 * i, 1 + 0.002 * i * i)
    turn[1, 2] += 2.0 * i + 0.5 * i * i
    return pair(i, texture=cv2.warpAffine(TEXTURE, turn, (WIDTH + 120, HEIGHT), borderMode=cv2.BORDER_REFLECT))


@pytest.mark.parametrize(
    ("right", "words"),
    [
        (range(6), ""),
        ((0, 0, 1, 2, 3, 4), "Each pair is of two moments: its right image shows the frame before"),
        ((1, 2, 3, 4, 5, 6), "Each pair is of two moments: its right image shows the frame after"),
        ((0, 1, 2, 4, 5, 6), "from one between 2 and 4 on: an image of the right camera is missing"),
        ((0,) * 6, ""),
    ],
)
def test_pairs_of_two_moments_are_told(right: tuple[int, ...], words: str) -> None:
    """The last is a camera that stands still on one side: of no single frame after or before."""
    pairs = [turned(moving(i).left, moving(shown).right) for i, shown in enumerate(right)]
    places = [(start, Look.of(pairs[start]), Look.of(pairs[start + 1])) for start in (1, 4)]
    note = moments_note(places)
    assert words in note and bool(words) == bool(note)


def test_pairs_of_a_camera_at_rest_are_not_spoken_of() -> None:
    look = Look.of(pair())
    assert moments_note([(0, look, look), (4, look, look)]) == ""
