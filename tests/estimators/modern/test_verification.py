"""A pose is confirmed by more features than a wrong pose would match."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from ispom.estimators.modern.verification import confirmed, matches_by_chance
from ispom.features.descriptors import match_near
from ispom.features.interfaces import Features
from ispom.features.sift import SIFT_MATCHER

COUNT, FEWEST, AROUND_PX = 800, 7, 5.0


def unit(descriptors: np.ndarray) -> np.ndarray:
    return (descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)).astype(np.float32)


def scene(alike: float) -> tuple[Features, Features, np.ndarray]:
    """Features of two images of one place, 8 % of which both show, and where the right pose expects them.

    `alike` (0..1): how much the descriptors of different features have in common.
    """
    rng = np.random.default_rng(3)
    common = rng.normal(size=128)
    own = alike * common + (1 - alike) * rng.normal(size=(COUNT, 128))
    expected = rng.uniform((0, 0), (640, 480), (COUNT, 2))
    shown = np.arange(COUNT) % 12 == 0
    other = alike * common + (1 - alike) * rng.normal(size=(COUNT, 128))
    now = np.where(shown[:, None], own, other)
    uv = expected + rng.normal(0, 0.5, expected.shape)

    def features(at: np.ndarray, descriptors: np.ndarray) -> Features:
        return Features(at.astype(np.float32), unit(descriptors))

    return features(expected, own), features(uv, now), expected


def matched(then: Features, now: Features, expected: np.ndarray) -> np.ndarray:
    return match_near(SIFT_MATCHER, then, now, expected, AROUND_PX)[:, 0]


def test_a_small_share_confirms_a_pose_where_chance_matches_nearly_nothing() -> None:
    then, now, expected = scene(alike=0.1)
    good = matched(then, now, expected)
    assert FEWEST < len(good) < 0.1 * COUNT
    assert matches_by_chance(SIFT_MATCHER, then, now, expected, AROUND_PX) < 3
    assert not confirmed(good, expected, FEWEST)
    assert confirmed(good, expected, FEWEST, partial(matches_by_chance, SIFT_MATCHER, then, now, expected, AROUND_PX))


def test_a_wrong_pose_is_not_confirmed_where_everything_looks_alike() -> None:
    then, now, expected = scene(alike=0.9)
    wrong = np.roll(expected, 1, axis=0)
    good = matched(then, now, wrong)
    chance = matches_by_chance(SIFT_MATCHER, then, now, wrong, AROUND_PX)
    assert len(good) == pytest.approx(chance, rel=0.5)
    few = good[: int(0.09 * COUNT)]
    assert not confirmed(few, wrong, FEWEST, lambda: chance)


def test_features_out_of_the_image_are_not_counted() -> None:
    then, now, expected = scene(alike=0.1)
    expected[::2] = np.nan
    good = matched(then, now, expected)
    assert confirmed(good, expected, FEWEST) == (len(good) >= 0.1 * COUNT / 2)
    nowhere = np.full_like(expected, np.nan)
    assert matches_by_chance(SIFT_MATCHER, then, now, nowhere, AROUND_PX) == 0
    assert not confirmed(np.zeros(0, np.int64), nowhere, FEWEST)


def test_one_thing_that_stands_elsewhere_as_well_is_no_place() -> None:
    _, _, expected = scene(alike=0.1)
    left = expected[:, 0] < 320
    one_thing = np.flatnonzero(left & (expected[:, 1] < 160))[: int(0.09 * COUNT)]
    everywhere = np.arange(0, COUNT, 12)
    assert confirmed(everywhere, expected, FEWEST, lambda: 1.0)
    assert not confirmed(one_thing, expected, FEWEST, lambda: 1.0)
