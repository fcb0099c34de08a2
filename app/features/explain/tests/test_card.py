"""The cards of Explain: what each method did at a frame, as values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ispom_app.engine.history.quantities import quantities
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.features.explain.card import cards

from ispom.estimators.modern.monocular import checks
from ispom.types import Decision, Status, Step, Tracks, TrackStatus

KEPT, BEGUN, LEFT, EPIPOLAR = TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.OUT_OF_IMAGE, TrackStatus.EPIPOLAR


def step(method: str, *decisions: Decision, **more: object) -> Step:
    seconds = {"track": 0.004, "unheard of": 0.001}
    return Step(0, Status.TRACKING, decisions=decisions, seconds=seconds, method=method, **more)  # type: ignore[arg-type]


def record(*steps: Step, **more: object) -> ExposureRecord:
    return ExposureRecord(7, 0, "video", steps, {}, {"monocular": 0.02}, {}, **more)  # type: ignore[arg-type]


def test_a_check_is_a_sentence_with_key_numbers_and_margin():
    (card,) = cards(record(step("monocular", checks.PARALLAX.of(1.2, 2.5))))
    ((row,),) = (group.checks for group in card.details.groups)
    assert row.sentence.startswith("No keyframe: parallax 1.2 ")
    assert (row.quantity, row.numbers) == ("monocular.parallax", "")
    assert row.mark == "○" and "did not fire" in row.hint


def test_the_stages_come_in_order_and_one_without_a_sentence_has_its_name():
    (card,) = cards(record(step("monocular")))
    assert [(stage.name, stage.ms) for stage in card.details.stages] == [("track", "4.0"), ("unheard of", "1.0")]
    assert card.details.stages[0].text.startswith("Tracks features") and card.details.stages[1].text == ""


def test_tracks_before_plus_new_minus_dropped_are_those_now():
    status = np.array([KEPT, KEPT, BEGUN, LEFT, EPIPOLAR, EPIPOLAR], np.uint8)
    uv_prev = np.where((status == BEGUN)[:, None], np.nan, 5.0) * np.ones((6, 2))
    tracks = Tracks.of(np.arange(6), np.ones((6, 2)), status=status, uv_prev=uv_prev)
    (card,) = cards(record(step("monocular", tracks={"video": tracks})))
    facts = [(fact.text, fact.quantity) for fact in card.details.facts if fact.label in ("video", "")]
    assert facts == [
        ("5 tracks before + 1 new − 3 dropped = 3 now", "monocular.alive"),
        ("− 2 off the epipolar line", "monocular.dropped_epipolar"),
        ("− 1 left the image", "monocular.dropped_out_of_image"),
    ]


def test_a_point_that_was_new_and_ended_at_once_counts_as_both():
    status = np.array([KEPT, TrackStatus.NO_DISPARITY], np.uint8)
    uv_prev = np.array([[5.0, 5.0], [np.nan, np.nan]])
    tracks = Tracks.of(np.arange(2), np.ones((2, 2)), status=status, uv_prev=uv_prev)
    (card,) = cards(record(step("stereo.paper", tracks={"left": tracks})))
    assert card.details.facts[0].text == "1 tracks before + 1 new − 1 dropped = 1 now"


def test_a_method_that_runs_inside_another_has_its_card_once():
    inner, other = step("monocular", checks.PARALLAX.of(3, 2.5)), step("stereo")
    outer = replace(step("integrated", parts=(inner,)), seconds={"monocular: track": 0.004, "place": 0.002})
    assert [card.label for card in cards(record(outer, other))] == ["Integrated", "Monocular", "Stereo"]
    assert [card.label for card in cards(record(inner, outer))] == ["Monocular", "Integrated"]
    outer_card = cards(record(outer))[0]
    assert outer_card.details.uses == "Monocular" and [stage.name for stage in outer_card.details.stages] == ["place"]


def test_every_number_that_can_be_plotted_names_a_quantity_of_the_run():
    tracks = Tracks.of(np.arange(10), np.ones((10, 2)), status=np.arange(10, dtype=np.uint8))
    made = step("monocular", checks.POSE_POINTS.of(20, 15), tracks={"video": tracks}, scale=1.0, scale_sigma=0.01)
    (card,) = cards(record(replace(made, residuals_px=np.ones(3))))
    named = {f.quantity for f in card.details.facts} | {c.quantity for g in card.details.groups for c in g.checks}
    assert named <= quantities(("monocular",)).keys() and len(named) > 12


def test_a_failed_check_that_decides_is_reported_once_with_its_limit_and_margin():
    decided, other = checks.SCALE_DRIFT.of(51, 10), checks.FOCAL_LENGTH.of(1, 0.9)
    (card,) = cards(record(step("monocular", checks.POSE_POINTS.of(200, 15), other, decided)))
    assert card.verdict.headline == "Scale unreliable" and card.decisive is not None
    assert (card.decisive.quantity, card.decisive.numbers) == (
        "monocular.scale_drift",
        "",
    )
    assert [row.quantity for row in card.failed] == ["monocular.focal_length"]


def test_a_method_that_did_not_step_has_the_verdict_of_its_last_step_and_no_details():
    pair = ExposureRecord(3, 0, "stereo", (step("stereo", checks.POSE_POINTS.of(20, 15)),), {}, {}, {})
    now = record(step("monocular", checks.POSE_POINTS.of(20, 15)))
    found = cards(now, ("stereo", "monocular", "integrated"), {"stereo": pair})
    assert [(c.verdict.method, c.when, c.details is None) for c in found] == [
        ("stereo", "at frame 3", True),
        ("monocular", "", False),
        ("integrated", "", True),
    ]
    assert found[2].verdict.headline == "Waiting"


def test_many_measurements_that_are_not_significant_share_a_line():
    made = [replace(checks.NOISE.of(0.1, 0.2), key=f"term_{i}") for i in range(17)]
    (card,) = cards(record(step("monocular", *made, checks.NOISE.of(0.3, 0.2))))
    assert card.details is not None
    assert [(len(g.checks), len(g.crowd)) for g in card.details.groups] == [(1, 17)]
