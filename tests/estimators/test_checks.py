"""What an estimator decides has a stable name, and comes from the closed set of its method."""

from __future__ import annotations

import re

import numpy as np
import pytest

from ispom.ensemble import build, run
from ispom.methods import BUILT_IN, Config
from ispom.methods import method as registered
from ispom.types import Check, Decision, Measurement, Sequence, Step, TrackStatus, by_key

CHECKS = {name: registered(name).checks for name in BUILT_IN}


@pytest.fixture(scope="module")
def steps(flight: Sequence, exposures: list[Measurement]) -> list[Step]:
    return [step for found in run(build(Config(), tuple(CHECKS), flight.rig), exposures) for step in found]


def test_every_decision_is_one_of_the_checks_of_its_method(steps: list[Step]) -> None:
    seen = {(step.method, decision.key): decision for step in steps for decision in step.decisions}
    for (method, key), decision in seen.items():
        check = CHECKS[method][key]
        described = (decision.name, decision.kind, decision.question, decision.relation, decision.unit)
        assert described == (check.name, check.kind, check.question, check.relation, check.unit)
    assert {method for method, _ in seen} == set(CHECKS)


def test_in_a_step_a_key_names_one_decision(steps: list[Step]) -> None:
    for step in steps:
        names = [(decision.key, decision.about) for decision in step.decisions]
        assert len(names) == len(set(names)), (step.method, step.time_ns)


def test_triggers_answer_whether_there_is_a_key_frame(steps: list[Step]) -> None:
    for step in steps:
        fired = [d.passed for d in step.decisions if d.question == "New keyframe?"]
        assert not fired or not step.key_frame or any(fired)
        assert not any(d.failed for d in step.decisions if d.kind != "requirement")


@pytest.mark.parametrize("method", CHECKS)
def test_keys_are_plain_names_and_triggers_have_a_question(method: str) -> None:
    for key, check in CHECKS[method].items():
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*", key)
        assert check.question.endswith("?") or (not check.question and check.kind != "trigger")


@pytest.mark.parametrize(("relation", "passes"), [(">=", True), ("<=", True), (">", False), ("<", False)])
def test_a_check_compares_as_its_relation_says(relation: str, passes: bool) -> None:
    found = Check("a_key", "a name", "finding", relation=relation, unit="px").of(2, 2, "so")  # type: ignore[arg-type]
    assert found == Decision("a name", 2.0, 2.0, passes, "px", relation, "so", "a_key", "", "finding")  # type: ignore


def test_two_checks_of_one_key_are_refused() -> None:
    with pytest.raises(ValueError, match="same, same"):
        by_key(Check("same", "one", "finding"), Check("same", "other", "finding"))


@pytest.mark.parametrize("method", CHECKS)
def test_each_check_and_each_stage_of_a_built_in_method_is_a_sentence(method: str, steps: list[Step]) -> None:
    for check in CHECKS[method].values():
        for text in (check.passes, check.fails or check.passes):
            assert text.endswith(".") and text[0] in "{ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789", (check.key, text)
        assert check.fails or check.kind == "finding", check.key
    stages = registered(method).stages
    own = {name for step in steps if step.method == method for name in step.seconds if ": " not in name}
    assert own <= stages.keys() and all(text.endswith(".") for text in stages.values())


@pytest.mark.parametrize("text", ["{}", "{threshhold}", "{value.real.x}", "{value:q}", "{"])
def test_a_sentence_that_cannot_be_filled_in_is_refused_at_once(text: str) -> None:
    with pytest.raises(ValueError, match="'a_key'"):
        Check("a_key", "a name", "finding", passes=text)


@pytest.mark.parametrize("method", ["monocular", "stereo", "integrated"])
def test_an_adjustment_reports_cost_iterations_outliers_and_what_left_the_window(
    method: str, steps: list[Step]
) -> None:
    keys = [{d.key: d for d in step.decisions} for step in steps if step.method == method]
    adjusted = [found for found in keys if "cost" in found]
    assert adjusted and all({"iterations", "outliers", "window"} <= found.keys() for found in adjusted)
    for found in adjusted:
        assert found["cost"].value <= found["cost"].threshold and found["iterations"].value >= 1
        assert 0 <= found["outliers"].value <= found["outliers"].threshold
        assert found["window"].passed == (not found["window"].consequence)


@pytest.mark.parametrize(("method", "camera"), [("monocular.paper", "video"), ("stereo.paper", "left")])
def test_the_papers_methods_report_how_many_points_disagree(method: str, camera: str, steps: list[Step]) -> None:
    dropped = (TrackStatus.EPIPOLAR, TrackStatus.REPROJECTION, TrackStatus.RIGID)
    reports = 0
    for step in steps:
        found = next((d for d in step.decisions if step.method == method and d.key == "outliers"), None)
        if found is not None:
            assert found.value == np.isin(step.tracks[camera].status, dropped).sum() <= found.threshold
            reports += 1
    assert reports >= 5


def test_the_first_map_reports_its_model_and_the_integrations_their_alignment(steps: list[Step]) -> None:
    seen = {f"{step.method}.{d.key}": d for step in steps for d in step.decisions}
    assert {"monocular.plane_share", "monocular.homography_cost", "integrated.align_turn"} <= seen.keys()
    assert {
        "integrated.paper.scale_ratio",
        "integrated.paper.scale_change",
        "monocular.paper.scale_spread",
    } <= seen.keys()
    assert abs(seen["integrated.align_scale"].value - 1) < 0.05
