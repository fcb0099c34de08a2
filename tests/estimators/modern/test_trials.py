"""Candidates of loops name the rule that decided; collecting changes nothing; what is asked for is done, and said."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.estimators.modern import trials
from ispom.estimators.modern.loops.asked import NOTHING_ASKED, Asked
from ispom.estimators.modern.loops.loops import Loops
from ispom.estimators.modern.loops.relative_pose import LoopCamera
from ispom.estimators.modern.trials import Trial, collecting_trials
from ispom.simulation.places.town import LAP_M
from tests.estimators.modern.loop_bench import CAMERA, Driven, Facades, driven
from tests.estimators.modern.test_loops import SINGLE, SINGLE_DRIFT, TERRACE_M

LENGTH_M = 1.06 * LAP_M


def lap(camera: LoopCamera, asked: Asked = NOTHING_ASKED) -> Driven:
    return driven(Facades.seeded(0), LENGTH_M, 0, camera, 1.0 if camera.baseline else SINGLE_DRIFT, asked=asked)


@pytest.fixture(
    scope="module", params=[pytest.param(CAMERA, id="pair"), pytest.param(SINGLE, id="single", marks=pytest.mark.slow)]
)
def camera(request: pytest.FixtureRequest) -> LoopCamera:
    return request.param


@pytest.fixture(scope="module")
def plain(camera: LoopCamera) -> Driven:
    return lap(camera)


@pytest.fixture(scope="module")
def collected(camera: LoopCamera) -> tuple[Driven, list[Trial]]:
    with collecting_trials() as found:
        result = lap(camera)
    return result, list(found.values())


def bytes_of(loops: Loops) -> bytes:
    """All poses and measured loops."""
    poses = [n.corrected.pose.matrix.tobytes() + np.float64(n.corrected.scale).tobytes() for n in loops.nodes]
    measured = [x.first_from_then.pose.matrix.tobytes() + x.covariance.tobytes() for x in loops.closed]
    return b"".join([*poses, *measured])


def test_results_are_the_same_with_and_without_collection(plain: Driven, collected: tuple[Driven, list[Trial]]) -> None:
    found, _ = collected
    assert bytes_of(found.loops) == bytes_of(plain.loops)
    assert found.decisions == plain.decisions


def test_every_closed_loop_is_an_accepted_candidate(collected: tuple[Driven, list[Trial]]) -> None:
    found, some = collected
    accepted = {(t.first_ns, t.then_ns) for t in some if t.accepted}
    assert accepted >= {(x.first_ns, x.then_ns) for x in found.loops.closed} and accepted
    for one in (t for t in some if t.accepted):
        assert one.pose is not None and one.matches is not None
        assert all(d.passed for d in one.rules.values()) and "loop_views" in one.rules
        assert one.matches.inlier.sum() >= one.rules["candidate_points"].value * 0.5
        assert len(one.matches.first) == len(one.matches.then) == len(one.matches.inlier)


def test_candidates_that_are_dropped_early_name_the_rule(collected: tuple[Driven, list[Trial]]) -> None:
    """Each node is compared with all that are old enough: none vanishes."""
    found, some = collected
    first_refusals = {next((k for k, d in t.rules.items() if not d.passed), "") for t in some if not t.accepted}
    assert first_refusals >= {"candidate_reach", "candidate_matches"}
    then_ns = found.loops.nodes[-1].time_ns
    assert {t.first_ns for t in some if t.then_ns == then_ns} == {n.time_ns for n in found.loops.nodes[:-12]}
    assert all(t.rules for t in some)


def test_equal_houses_are_refused_by_a_rule() -> None:
    with collecting_trials() as found:
        driven(Facades.seeded(0, TERRACE_M), 0.5 * LAP_M, 0, SINGLE, SINGLE_DRIFT)
    assert found
    for one in found.values():
        assert not one.accepted and any(not decision.passed for decision in one.rules.values())


def test_a_refused_loop_is_not_closed_and_says_so(camera: LoopCamera, plain: Driven) -> None:
    first = plain.loops.closed[0]
    pair = (first.first_ns, first.then_ns)
    found = lap(camera, Asked(refused=frozenset({pair})))
    assert pair not in {(x.first_ns, x.then_ns) for x in (*found.loops.closed, *found.loops.proposed)}
    asked = [d for d in found.decisions if d.key == "loop_asked"]
    assert [d.passed for d in asked] == [False]


def test_an_accepted_loop_is_closed_and_says_that_it_was_asked_for(
    camera: LoopCamera, collected: tuple[Driven, list[Trial]]
) -> None:
    _, some = collected
    early = next(t for t in some if t.pose is not None and "loop_views" in t.rules)
    pair = (early.first_ns, early.then_ns)
    with collecting_trials() as again:
        found = lap(camera, Asked(accepted=frozenset({pair})))
    keys = [d.key for d in found.decisions]
    asked = keys.index("loop_asked")
    assert found.decisions[asked].passed and keys[asked + 1] == "loop_shift"
    # It is first closed by itself: the views that would confirm it are not there yet.
    views = next(t for t in again.values() if (t.first_ns, t.then_ns) == pair).rules["loop_views"]
    assert views.value == 1 and "loop_views" not in keys[:asked]


@pytest.mark.parametrize("text", ["5", "7-5", "a-b", "1-2-3", "-1-5"])
def test_a_text_that_is_no_pair_is_a_mistake(text: str) -> None:
    with pytest.raises(InputError, match="refuse_loops"):
        Asked.of(text, "")


def test_pairs_are_read_and_cannot_be_both() -> None:
    assert Asked.of("1-2, 3-4", "").refused == {(1, 2), (3, 4)}
    assert Asked.of("", "1-2,").accepted_with(2) == (1,)
    with pytest.raises(InputError, match="both"):
        Asked.of("1-2", "1-2")


def test_keys_of_rules_are_unique() -> None:
    assert len({rule.key for rule in trials.RULES}) == len(trials.RULES)
