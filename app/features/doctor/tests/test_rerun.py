"""A run that lost tracking by one of its settings: the doctor forks it and names that setting."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import pytest

from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.evaluation.doctor.reruns import Outcome, Reruns, Tried
from ispom.evaluation.metrics import path_errors
from ispom.methods import Config
from ispom.sequences import open_sequence
from ispom.settings import alternatives

from ....engine.differences.compare import MethodRow, step_row
from ....engine.events import Stepped
from ....engine.playback import Playback
from ....engine.run_events.stretch import Stretch
from .. import rerun as of_rerun
from ..job import Progress, examine
from ..origin import Origin
from ..rerun import KNOWN, rerun, set_back, with_noise

FIRST, LAST = 30, 55
STRETCH = Stretch(FIRST, LAST, 50)


def playback(max_tracks: int) -> Playback:
    config = Config({"monocular": ModernMonocularConfig(max_tracks=max_tracks)})
    return Playback(open_sequence("sim:tiny"), ("monocular",), config)


@cache
def run(max_tracks: int) -> tuple[Stepped, ...]:
    """A run up to the end of the stretch."""
    own = playback(max_tracks)
    return tuple(own.step() for _ in range(LAST + 1))


def origin(max_tracks: int) -> Origin:
    def rows(first: int, last: int) -> Iterator[MethodRow]:
        for event in run(max_tracks)[first : last + 1]:
            yield from (step_row(event.index, step, event.errors_m.get(step.method)) for step in event.steps)

    return Origin(lambda: playback(max_tracks), rows, lambda: playback(max_tracks))


def reran(max_tracks: int, advance: Callable[[str], bool] = lambda doing: True) -> Reruns:
    return rerun(origin(max_tracks), STRETCH, advance)


@cache
def of_few_tracks() -> Reruns:
    return reran(50, tracks_only)


def tracks_only(doing: str) -> bool:
    """Leaves out the other settings, which take their time."""
    return " with " not in doing or "max-tracks" in doing


def nothing(doing: str) -> bool:
    return " with " not in doing


def test_far_too_few_tracks_are_named_with_the_option_that_helps() -> None:
    found = of_few_tracks()
    best = found.best
    assert best is not None and best.trial.option == "--monocular.max-tracks 500"
    assert len(best.outcomes) == len(best.unchanged) == 3
    assert found.ranked[0].suspect.key == "monocular.max-tracks" and found.ranked[0].finding.found


@cache
def of_few_tracks_set_back() -> Reruns:
    found = set_back(origin(50), STRETCH, lambda doing: True)
    assert found is not None
    return found


def test_a_setting_that_differs_from_its_default_is_set_back_to_it_over_the_whole_run() -> None:
    found = of_few_tracks_set_back()
    assert [t.trial.option for t in found.tried] == ["--monocular.max-tracks 500"]
    assert (found.first, found.last) == (0, len(open_sequence("sim:tiny")) - 1)
    best = found.best
    assert best is not None and len(best.outcomes) == len(best.unchanged) == 3
    assert found.ranked[0].suspect.how == "setting" and found.ranked[0].finding.found


def test_the_error_of_a_rerun_is_that_of_the_metrics() -> None:
    sequence, outcome = open_sequence("sim:tiny"), of_few_tracks_set_back().tried[0].outcomes[0]
    whole = playback(500)
    while not whole.done:
        whole.step()
    trajectory = whole.finish().trajectories["monocular"]
    assert sequence.truth is not None
    assert outcome.error_m == path_errors(trajectory, sequence.truth, sequence.rig, metric=False)["ate_m"]


def test_a_run_by_default_has_nothing_to_set_back() -> None:
    assert set_back(origin(500), STRETCH, lambda doing: False) is None


def test_what_was_set_back_is_not_tried_again() -> None:
    unhelpful = replace(of_few_tracks_set_back(), tried=tuple(replace(t, outcomes=t.unchanged) for t in seen()))
    found = rerun(origin(50), STRETCH, nothing, unhelpful)
    assert "--monocular.max-tracks 500" not in found.left and found.left


def seen() -> tuple[Tried, ...]:
    return of_few_tracks_set_back().tried


def test_where_a_setting_that_was_set_back_is_the_cause_no_other_one_is_tried() -> None:
    found = rerun(origin(50), STRETCH, nothing, of_few_tracks_set_back())
    assert not found.tried and not found.left and found.note == KNOWN
    other = Origin(lambda: playback(51), origin(50).rows, lambda: playback(51))
    assert rerun(other, STRETCH, nothing, of_few_tracks_set_back()).note != KNOWN, "the rerun is still compared"


@pytest.mark.parametrize(("located", "tried"), [(24, 1), (12, len(alternatives(ModernMonocularConfig(max_tracks=50))))])
def test_where_a_setting_leaves_nothing_to_improve_no_other_one_is_tried(
    located: int, tried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes = [Outcome(24, dict.fromkeys(range(count), 0.3), 0, {}, 0) for count in (located, 0)]
    monkeypatch.setattr(
        of_rerun._Bench, "tried", lambda bench, trial, seen: Tried(trial, (outcomes[0],) * 3, (outcomes[1],) * 3)
    )
    found = reran(50)
    assert len(found.tried) == tried and found.best is not None and not found.left


def test_what_is_known_is_told_when_each_rerun_of_a_setting_has_ended() -> None:
    told = list[Reruns]()
    found = rerun(origin(50), STRETCH, tracks_only, known=told.append)
    assert [len(each.tried[-1].outcomes) for each in told if len(each.tried) == 1] == [1, 2, 3, 3]
    assert told[0].best is not None and told[-1].tried == found.tried


def test_settings_are_set_back_before_the_suspects() -> None:
    doing = list[str]()
    now = iter(range(10_000))
    found = examine(
        open_sequence("sim:tiny"), STRETCH, 3, lambda p: doing.append(p.doing), lambda: next(now), origin(50)
    )
    assert "max-tracks" in doing[0] and any("reading" in each for each in doing[1:])
    assert found.set_back is not None and found.set_back.left == ("--monocular.max-tracks 500",)


def test_an_examination_says_a_cause_when_one_rerun_shows_it_and_ends_when_others_confirm_it() -> None:
    told = list[Progress]()
    found = examine(open_sequence("sim:tiny"), STRETCH, 1000, told.append, origin=origin(50))
    known = [each.known for each in told if each.known is not None and each.known.causes]
    assert all(each.causes[0].suspect.key == "monocular.max-tracks" for each in (*known, found))
    assert known[0].set_back is not None and len(known[0].set_back.tried[0].outcomes) == 1
    assert found.reruns is not None and not found.reruns.tried and not found.left
    doing = [each.doing for each in told if " with " in each.doing]
    assert all("max-tracks" in each for each in doing)


def test_the_unchanged_rerun_is_the_run() -> None:
    assert not of_few_tracks().note


def test_a_run_that_is_not_the_same_is_said() -> None:
    other = Origin(lambda: playback(51), origin(50).rows, lambda: playback(51))
    assert rerun(other, STRETCH, nothing).note


def test_a_healthy_run_has_nothing_to_try() -> None:
    found = reran(500)
    assert not found.tried and found.best is None and found.note


def test_without_time_the_rest_is_listed() -> None:
    found = reran(50, nothing)
    assert not found.tried and "--monocular.max-tracks 500" in found.left


def test_it_is_cancelled_between_two_frames() -> None:
    class Cancelled(Exception):
        pass

    frames = 0

    def advance(doing: str) -> bool:
        nonlocal frames
        frames += 1
        if frames == FIRST + 5:
            raise Cancelled
        return True

    with pytest.raises(Cancelled):
        reran(50, advance)
    assert frames == FIRST + 5


def test_noise_is_small_and_always_the_same() -> None:
    sequence = open_sequence("sim:tiny")
    index = sequence.kinds.index("video")
    a, b, other = (with_noise(sequence, seed).load(index).image.astype(int) for seed in (1, 1, 2))
    clean = sequence.load(index).image.astype(int)
    assert (a == b).all() and (a != other).any() and (a != clean).any() and abs(a - clean).max() == 1
