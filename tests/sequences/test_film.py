"""Cuts, titles and repeated images of a film are named when it is opened; films without them are not spoken of."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from ispom.features.pair_look import with_look
from ispom.plausibility.doubt import keys_of
from ispom.types import Camera, Frame, Image, Rig, Sequence

WIDTH, HEIGHT, COUNT = 320, 240, 40
SCENE = cv2.resize(np.random.default_rng(5).integers(0, 256, (8, 54), np.uint8), (1600, HEIGHT), None, 0, 0, 2)


def view(k: int, exposure: float = 1.0) -> Image:
    """Of a camera that trembles while it goes to the right."""
    x = 3 * k + round(2 * np.sin(k))
    return np.ascontiguousarray(np.clip(SCENE[:, x : x + WIDTH] * exposure, 0, 255).astype(np.uint8))


def title(k: int) -> Image:
    """Coded, so that images differ a little."""
    image = np.full((HEIGHT, WIDTH), 20, np.uint8)
    cv2.putText(image, "A film", (60, 120), cv2.FONT_HERSHEY_SIMPLEX, 2, 255, 4)
    image[100 + k % 3, ::40] += 1
    return image


def film(made: Callable[[int], Image], times_ns: np.ndarray | None = None) -> Sequence:
    times_ns = np.arange(COUNT) * 33_000_000 if times_ns is None else times_ns
    rig = Rig.single(Camera(WIDTH, HEIGHT, 300, 300, 160, 120))
    return Sequence("film", rig, times_ns, ("video",) * COUNT, lambda i: Frame.video(int(times_ns[i]), made(i)))


@pytest.mark.parametrize(
    ("made", "keys"),
    [
        (view, set()),
        (lambda k: view(k, 1.0 if k < 20 else 0.6), set()),
        (lambda k: view(min(k, 20)), set()),
        (lambda k: view(max(k, 20)), set()),
        (lambda k: view(k if k < 20 else k + 150), {"images_cut"}),
        (lambda k: title(k) if k < 12 else view(k), {"images_title"}),
        (lambda k: title(k) if 15 <= k < 25 else view(k), {"images_title"}),
        (lambda k: view(k - (k % 5 == 4)), {"images_repeated"}),
    ],
    ids=["moving", "exposure", "stops", "starts", "cut", "title", "title within", "repeated"],
)
def test_films_give_their_note(made: Callable[[int], Image], keys: set[str]) -> None:
    assert keys_of(with_look(film(made)).notes) == keys


def test_a_gap_that_the_times_have_is_no_cut() -> None:
    times_ns = (np.arange(COUNT) + 150 * (np.arange(COUNT) >= 20)) * 33_000_000
    assert not keys_of(with_look(film(lambda k: view(k if k < 20 else k + 150), times_ns)).notes)


def test_a_title_at_the_begin_is_left_out() -> None:
    whole = film(lambda k: title(k) if k < 12 else view(k))
    seen = with_look(whole)
    assert len(seen) == COUNT - 12 and seen.times_ns[0] == whole.times_ns[12]
    assert np.array_equal(seen.load(0).image, view(12))  # type: ignore[union-attr]
