"""Tracks from one image to the next, and places found otherwise checked by the way back."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ispom.features.klt import Klt
from ispom.types import Image, TrackStatus

SHIFT_PX = 3, -2


@pytest.fixture
def pair() -> tuple[Image, Image]:
    """A texture of some pixels, and the same moved by SHIFT_PX."""
    first = _texture(0)
    return first, np.roll(first, SHIFT_PX[::-1], axis=(0, 1))


def _texture(seed: int) -> Image:
    texture = np.random.default_rng(seed).uniform(0, 255, (120, 160)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 2)
    return np.asarray((texture - texture.min()) / np.ptp(texture) * 255, np.uint8)


def inside() -> NDArray[np.float32]:
    """(N, 2) [px] away from the border."""
    u, v = np.meshgrid(np.arange(30, 130, 9), np.arange(30, 90, 9))
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)


def test_points_are_followed(pair: tuple[Image, Image]) -> None:
    uv = inside()
    found, status = Klt(levels=1).track(*pair, uv)
    assert (status == TrackStatus.ALIVE).all()
    assert np.abs(found - uv - np.array(SHIFT_PX, np.float32)).max() < 0.02


def test_places_that_lead_back_are_alive_and_others_say_why_not(pair: tuple[Image, Image]) -> None:
    klt, uv = Klt(levels=1), inside()
    right = uv + np.array(SHIFT_PX, np.float32)
    assert (klt.checked(*pair, uv, right) == TrackStatus.ALIVE).all()
    wrong = klt.checked(*pair, uv, right + np.array((1.5, 0), np.float32))
    assert (wrong == TrackStatus.FORWARD_BACKWARD).all()
    outside = np.broadcast_to(np.array((158, 60), np.float32), uv.shape)
    assert (klt.checked(*pair, uv, outside) == TrackStatus.OUT_OF_IMAGE).all()


def test_what_is_found_is_what_the_check_keeps(pair: tuple[Image, Image]) -> None:
    uv = inside()
    one_way, _ = Klt(levels=1, max_forward_backward_px=np.inf).track(*pair, uv)
    found, status = Klt(levels=1).track(*pair, uv)
    np.testing.assert_array_equal(found, one_way)
    np.testing.assert_array_equal(status, Klt(levels=1).checked(*pair, uv, one_way))


def test_a_search_back_that_does_not_know_its_answer_passes_fewer_wrong_tracks(pair: tuple[Image, Image]) -> None:
    def alive(klt: Klt, a: Image, b: Image) -> int:
        return int((klt.track(a, b, inside())[1] == TrackStatus.ALIVE).sum())

    plain = Klt(levels=1)
    blind = replace(plain, back_from_guess=True)
    assert alive(blind, *pair) == len(inside())
    unrelated = [(pair[0], np.ascontiguousarray(np.rot90(pair[0], 2)))]
    unrelated += [(_texture(seed), _texture(100 + seed)) for seed in range(10)]
    passed = np.array([[alive(klt, *images) for klt in (plain, blind)] for images in unrelated]).sum(axis=0)
    assert passed[1] < 0.75 * passed[0]
