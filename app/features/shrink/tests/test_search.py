"""The search, over tests that read no image."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from ispom_app.features.shrink.search import Clip, Shrunk, neighbours, shrunk

MOST = 400
WHOLE = Clip(0, 99, ("monocular", "stereo"), ("stereo", "video"))


def found(fails, whole: Clip = WHOLE, end: int = 60, most: int = MOST) -> Shrunk:
    result = shrunk(whole, end, fails, most)
    assert result is not None
    return result


def test_each_direction_is_shrunk_to_its_limit() -> None:
    def fails(clip: Clip) -> bool:
        fast = clip.every <= 3 and clip.halvings <= 2 and "stereo" in clip.cameras
        return fast and "monocular" in clip.methods and clip.first <= 41 and clip.last >= 60

    result = found(fails)
    assert result.complete
    assert result.clip.last == 60 and result.clip.first in (39, 40, 41) and result.clip.every == 3
    assert result.clip.methods == ("monocular",) and result.clip.cameras == ("stereo",) and result.clip.halvings == 2
    assert len(result.trials) < 40


def test_a_failure_that_does_not_repeat_is_none() -> None:
    assert shrunk(WHOLE, 60, lambda clip: False, MOST) is None
    assert shrunk(WHOLE, 60, lambda clip: True, 0) is None


def test_what_is_needed_together_stays() -> None:
    both = found(lambda clip: len(clip.methods) == 2 and len(clip.cameras) == 2 and clip.last >= 60).clip
    assert both.methods == WHOLE.methods and both.cameras == WHOLE.cameras


def test_a_clip_has_the_frames_back_from_its_last_one() -> None:
    clip = Clip(3, 10, ("a",), ("video",), every=3)
    assert list(clip.frames) == [4, 7, 10] and clip.count == 3
    assert list(clip.of_count(2).frames) == [7, 10] and list(clip.thinned(2).frames) == [3, 10]
    assert list(Clip(1, 6, ("a",), ("video",)).thinned(4).frames) == [0, 2, 4, 6]
    assert list(Clip(0, 5, ("a",), ("video",)).thinned(4).frames) == [1, 3, 5]


@st.composite
def rules(draw: st.DrawFn):
    """Any rule that says the same of a clip each time, also one under which longer clips do not fail."""
    salt, share = draw(st.integers(0, 1 << 30)), draw(st.integers(0, 100))
    end = draw(st.integers(0, 40))
    length, every, halvings = draw(st.integers(1, 20)), draw(st.integers(1, 4)), draw(st.integers(0, 3))
    even = draw(st.booleans())

    def fails(clip: Clip) -> bool:
        if clip == replace(WHOLE, last=40):
            return True
        sound = clip.first <= end - length + 1 and clip.last >= end and clip.every <= every
        sound = sound and clip.halvings <= halvings
        return sound and (even or hash((salt, clip)) % 100 < share)

    return end, fails


@given(rules())
def test_the_clip_fails_and_no_step_further_does(rule) -> None:
    end, fails = rule
    ran: list[Clip] = []

    def once(clip: Clip) -> bool:
        ran.append(clip)
        return fails(clip)

    result = found(once, replace(WHOLE, last=40), end, MOST)
    assert fails(result.clip) and result.complete
    assert not any(fails(clip) for clip in neighbours(result.clip))
    assert len(set(ran)) == len(ran) == len(result.trials) < 150


@given(rules(), st.integers(1, 30))
def test_trials_are_bounded_and_the_best_so_far_is_given(rule, most: int) -> None:
    end, fails = rule
    result = found(fails, replace(WHOLE, last=40), end, most)
    assert fails(result.clip) and len(result.trials) <= most
    assert result.complete or len(result.trials) == most
