"""What every registered front end must do, whatever it is made of."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.features.front_ends import KLT, REGISTRY, front_end, front_ends
from ispom.features.interfaces import FrontEnd
from ispom.settings import check, settings
from ispom.types import Image, TrackStatus

SHIFT_PX = np.array([5, -3], np.float32)
COUNT, DISTANCE_PX = 150, 7.0
REFINED_PX = 3
"""By which a detector may move points to the sub-pixel after it chose them."""
NOWHERE = np.zeros((0, 2), np.float32)
BLANK = {
    "empty": np.zeros((0, 0), np.uint8),
    "one pixel": np.full((1, 1), 90, np.uint8),
    "no texture": np.full((120, 160), 90, np.uint8),
}


@pytest.fixture(params=front_ends())
def front(request: pytest.FixtureRequest) -> FrontEnd:
    return front_end(request.param)


@pytest.fixture(scope="module")
def pair() -> tuple[Image, Image]:
    """A texture of some pixels, and the same moved by SHIFT_PX."""
    noise = np.random.default_rng(0).uniform(0, 255, (240, 320)).astype(np.float32)
    texture = cv2.GaussianBlur(noise, (0, 0), 2)
    first = np.asarray((texture - texture.min()) / np.ptp(texture) * 255, np.uint8)
    return first, np.roll(first, SHIFT_PX[::-1].astype(int), axis=(0, 1))


def inner(uv: np.ndarray) -> np.ndarray:
    """The points that keep away from the border, where the moved image wraps around."""
    return uv[((uv > 45) & (uv < np.array([320, 240]) - 45)).all(axis=1)]


def test_detected_points_are_spread_and_keep_their_distance(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    first = front.detector.detect(pair[0], COUNT, NOWHERE, DISTANCE_PX)
    assert first.dtype == np.float32 and first.shape[1] == 2 and COUNT / 2 < len(first) <= COUNT
    assert (first >= 0).all() and (first <= (319, 239)).all()
    more = front.detector.detect(pair[0], 2 * COUNT, first, DISTANCE_PX)
    assert len(more) <= 2 * COUNT - len(first) and len(more)
    every = np.concatenate([first, more])
    apart = np.linalg.norm(every[:, None] - every[None], axis=2) + 1e9 * np.eye(len(every))
    nearest = apart.min(axis=1)
    assert nearest.min() > DISTANCE_PX - 2 * REFINED_PX and np.median(nearest) >= DISTANCE_PX
    quarters = np.bincount((every[:, 0] > 160) * 2 + (every[:, 1] > 120), minlength=4)
    assert quarters.min() > 0.1 * len(every)


def test_points_are_tracked(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    uv = front.detector.detect(pair[0], COUNT, NOWHERE, DISTANCE_PX)
    uv = inner(uv)
    for tracker in (front.tracker, front.guided):
        found, status = tracker.track(*pair, uv, (uv + 0.8 * SHIFT_PX).astype(np.float32))
        assert found.shape == uv.shape and found.dtype == np.float32
        assert status.shape == uv.shape[:1] and status.dtype == np.uint8
        alive = status == TrackStatus.ALIVE
        assert alive.mean() > 0.6
        off = np.linalg.norm(found - uv - SHIFT_PX, axis=1)[alive]
        assert np.median(off) < 0.1 and (off < 1).mean() > 0.95
        without = tracker.track(*pair, uv)
        assert without[0].shape == uv.shape


def test_features_are_matched(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    a, b = (front.descriptor.detect_and_describe(image, 500) for image in pair)
    assert a.uv.dtype == np.float32 and a.described and len(a.descriptors) == len(a) > 50
    assert a.descriptors.dtype in (np.uint8, np.float32) and a.compact().descriptors.dtype == np.uint8
    for some in ((a, b), (a.compact(), b.compact())):
        pairs = front.matcher.match(*some)
        assert len(pairs) > 30 and all(len(set(column)) == len(pairs) for column in pairs.T.tolist())
        off = np.linalg.norm(b.uv[pairs[:, 1]] - a.uv[pairs[:, 0]] - SHIFT_PX, axis=1)
        assert (off < 2).mean() > 0.9


def test_only_allowed_features_are_matched(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    a = front.descriptor.detect_and_describe(pair[0], 500)
    same, similarity = front.matcher.match_where(a, a, lambda rows: np.eye(len(a), dtype=bool)[rows])
    assert (same[:, 0] == same[:, 1]).all() and len(same) == len(a) and similarity == pytest.approx(1, abs=0.02)
    none, _ = front.matcher.match_where(a, a, lambda rows: np.zeros((len(a), len(a)), bool)[rows])
    assert none.shape == (0, 2) and none.dtype == np.int64


def test_points_are_described_where_they_are(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    uv = np.array([[0, 0], [100.25, 80.5], [319, 239], [200, 120]], np.float32)
    here = front.descriptor.describe(pair[0], uv)
    np.testing.assert_array_equal(here.uv, uv)
    there = front.descriptor.describe(pair[1], uv + SHIFT_PX)
    pairs, _ = front.matcher.match_where(here, there, lambda rows: np.ones((4, 4), bool)[rows])
    assert {(1, 1), (3, 3)} <= {(i, j) for i, j in pairs.tolist()}


def test_the_same_images_give_the_same_bits(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    def everything() -> list[np.ndarray]:
        uv = front.detector.detect(pair[0], COUNT, NOWHERE, DISTANCE_PX)
        a, b = (front.descriptor.detect_and_describe(image, 300) for image in pair)
        tracked = front.tracker.track(*pair, uv), front.guided.track(*pair, uv, uv + SHIFT_PX)
        return [uv, a.uv, a.descriptors, front.matcher.match(a, b), *tracked[0], *tracked[1]]

    before = [image.copy() for image in pair]
    for one, other in zip(everything(), everything(), strict=True):
        np.testing.assert_array_equal(one, other)
    for image, copy in zip(pair, before, strict=True):
        np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("image", BLANK.values(), ids=BLANK)
def test_where_nothing_is_to_be_seen_nothing_is_found(front: FrontEnd, image: Image) -> None:
    assert front.detector.detect(image, COUNT, NOWHERE, DISTANCE_PX).shape == (0, 2)
    features = front.descriptor.detect_and_describe(image, 300)
    assert features.uv.shape == (0, 2) and features.descriptors.shape[0] == 0 and features.described
    assert front.matcher.match(features, features).shape == (0, 2)
    pairs, similarity = front.matcher.match_where(features, features, lambda rows: np.zeros((0, 0), bool))
    assert pairs.shape == (0, 2) and similarity.shape == (0,)
    for tracker in (front.tracker, front.guided):
        uv, status = tracker.track(image, image, NOWHERE)
        assert uv.shape == (0, 2) and status.shape == (0,)


def test_what_has_no_texture_is_not_tracked(front: FrontEnd, pair: tuple[Image, Image]) -> None:
    grey, uv = np.full_like(pair[0], 90), np.array([[100, 100], [200, 80]], np.float32)
    for tracker in (front.tracker, front.guided):
        _, status = tracker.track(grey, grey, uv, uv)
        assert (status != TrackStatus.ALIVE).all()


def test_the_default_comes_first_and_others_are_named_where_one_is_unknown() -> None:
    assert front_ends()[:5] == ("klt", "corners", "patches", "sift", "orb") and REGISTRY.items()["klt"] is KLT
    with pytest.raises(InputError, match="klt, corners, patches, sift, orb"):
        front_end("freak")
    with pytest.raises(InputError, match=r"--monocular\.features is 'freak'.*klt, corners, patches, sift, orb"):
        check(ModernMonocularConfig(features="freak"), "monocular.")
    (setting,) = (s for s in settings(ModernMonocularConfig) if s.name == "features")
    assert setting.type.__args__ == front_ends()


def test_features_of_another_kind_match_nothing(pair: tuple[Image, Image]) -> None:
    sift, orb = front_end("sift"), front_end("orb")
    a, b = (front.descriptor.detect_and_describe(pair[0], 300) for front in (sift, orb))
    for matcher in (sift.matcher, orb.matcher):
        assert not len(matcher.match(a, b)) and not len(matcher.match(b.compact(), a.compact()))
        assert not len(matcher.match_where(a, b, lambda rows: np.ones((len(a), len(b)), bool)[rows])[0])
