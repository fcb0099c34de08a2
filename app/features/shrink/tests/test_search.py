"""The search, over tests that read no image."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st
from ispom_app.features.shrink.search import Clip, Shrunk, neighbours, shrunk, spans

LAST, MOST = 24, 2000
SHORT = Clip(tuple(range(LAST + 1)), ("monocular", "stereo"), ("stereo", "video"))
WHOLE = Clip(tuple(range(100)), ("monocular", "stereo"), ("stereo", "video"))


def found(fails, whole: Clip = WHOLE, end: int = 60, most: int = MOST) -> Shrunk:
    result = shrunk(whole, end, fails, most)
    assert result is not None
    return result


def test_each_direction_is_shrunk_to_its_limit() -> None:
    def fails(clip: Clip) -> bool:
        gaps = [b - a for a, b in pairwise(clip.frames)]
        fast = max(gaps, default=0) <= 3 and clip.halvings <= 2 and "stereo" in clip.cameras
        return fast and "monocular" in clip.methods and clip.frames[0] <= 41 and clip.frames[-1] >= 60

    result = found(fails)
    assert result.complete
    assert result.clip.frames[-1] == 60 and result.clip.frames[0] == 41 and result.clip.count <= 9
    assert result.clip.methods == ("monocular",) and result.clip.cameras == ("stereo",) and result.clip.halvings == 2
    assert len(result.trials) < 70


def test_a_failure_that_does_not_repeat_is_none() -> None:
    assert shrunk(WHOLE, 60, lambda clip: False, MOST) is None
    assert shrunk(WHOLE, 60, lambda clip: True, 0) is None


def test_what_is_needed_together_stays() -> None:
    both = found(lambda clip: len(clip.methods) == 2 and len(clip.cameras) == 2 and clip.frames[-1] >= 60).clip
    assert both.methods == WHOLE.methods and both.cameras == WHOLE.cameras


def test_a_clip_is_cut_at_both_ends_and_thinned_with_them() -> None:
    clip = Clip((3, 4, 5, 6, 7, 8), ("a",), ("video",))
    assert clip.of_count(2).frames == (7, 8) and clip.of_begin(2).frames == (3, 4)
    assert clip.thinned(3).frames == (3, 7, 8) and clip.thinned(4).frames == (3, 5, 7, 8)
    assert all(clip.thinned(n).count <= n for n in range(3, 7))


def test_numbers_of_frames_are_short_in_words() -> None:
    assert spans((3,)) == "3" and spans((3, 4)) == "3 to 4" and spans((3, 5)) == "3, 5"
    assert spans((0, 4, 6, 8, 9, 10)) == "0, 4 to 8 by 2, 9 to 10"


@st.composite
def rules(draw: st.DrawFn):
    """Any rule that says the same of a clip each time, also one under which longer clips do not fail."""
    salt, share = draw(st.integers(0, 1 << 30)), draw(st.integers(0, 100))
    needed = draw(st.frozensets(st.integers(0, LAST), min_size=1, max_size=8))
    halvings, even = draw(st.integers(0, 3)), draw(st.booleans())

    def fails(clip: Clip) -> bool:
        if clip == SHORT:
            return True
        sound = needed <= set(clip.frames) and clip.halvings <= halvings
        return sound and (even or hash((salt, clip)) % 100 < share)

    return max(needed), fails


@given(rules())
def test_the_clip_fails_and_does_not_without_any_part(rule) -> None:
    end, fails = rule
    ran: list[Clip] = []

    def once(clip: Clip) -> bool:
        ran.append(clip)
        return fails(clip)

    result = found(once, SHORT, end, MOST)
    assert fails(result.clip) and result.complete
    assert not any(fails(clip) for clip in neighbours(result.clip))
    assert len(set(ran)) == len(ran) == len(result.trials)


@given(rules(), st.integers(1, 30))
def test_trials_are_bounded_and_the_best_so_far_is_given(rule, most: int) -> None:
    end, fails = rule
    result = found(fails, SHORT, end, most)
    assert fails(result.clip) and len(result.trials) <= most
    assert result.complete or len(result.trials) == most
