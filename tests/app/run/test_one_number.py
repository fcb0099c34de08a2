"""One run, looked at from everywhere: card, header, dock, report, published page, recording and agents agree."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from ispom_app.engine.frame_record import DEFINITIONS, ERROR, INLIERS, LIVE_ERROR, RESIDUAL, FrameRecord
from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.tool import tools
from ispom_app.features.explain.card import cards
from ispom_app.features.plots.commands import Plots
from ispom_app.features.plots.page_message import PlotNews
from ispom_app.features.publish.messages import finished_state, run_message
from ispom_app.features.publish.panels import frame_panels, values_at
from ispom_app.features.publish.review import reviewed
from ispom_app.features.report.folder import read_run
from ispom_app.features.report.results import results
from ispom_app.presentation.texts import length
from ispom_app.session.branches.state import Branches
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.review.recording import read_recording
from ispom_app.session.session import Session
from ispom_app.session.state import State
from ispom_app.views.web.messages import message_of

from tests.app.helpers import ran

METHODS = ("monocular", "stereo", "integrated")
FRAMES = 60
PLOTS = ("error", "inliers", "residual_median_px", "error_m")


@dataclass(frozen=True, eq=False)
class Seen:
    folder: Path
    session: Session
    run: CurrentRun
    state: State

    def at(self, index: int) -> State:
        return replace(self.state, displayed=self.run.history[index])

    @property
    def dock(self) -> dict[str, dict[int, float | None]]:
        """By curve, the values by frame."""
        news = PlotNews().since(self.state.having(Plots(PLOTS)), self.run)
        assert news is not None
        return {c: dict(zip(f, v, strict=True)) for c, f, v in (*news["values"], *news["errors"])}


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seen]:
    folder = tmp_path_factory.mktemp("run") / "one"
    words = ["--max-exposures", str(FRAMES), "--methods", *METHODS]
    ran("sim:tiny", folder, "--seed", "1", *words)
    with reviewed([folder], ["one"]) as review:
        run = review.session.run
        assert run is not None
        yield Seen(folder, review.session, run, finished_state(review.session.state, "one"))


def cards_of(seen: Seen, index: int) -> dict[str, Any]:
    state = seen.at(index)
    assert state.displayed is not None
    return {card.verdict.method: card for card in cards(state.displayed, curves=state[Branches].curves)}


def headlines(panels: list[dict[str, Any]], index: int) -> set[str]:
    """Of the cards of a published page."""
    return {card["headline"] for card in panels[index]["cards"]}


def numbers(card: Any) -> dict[str, str]:
    """By quantity, what a card says of it."""
    return {fact.quantity.rpartition(".")[2]: fact.text for fact in card.details.facts if fact.quantity}


def test_the_word_is_one_in_header_card_published_page_recording_and_answers(seen: Seen) -> None:
    found = run_message(seen.state, seen.run)
    first = values_at(seen.state, seen.run, 0)["explain"]
    panels = [first | values["explain"] for values in frame_panels(seen.state, seen.run)]
    agent = AgentSession(seen.session)
    words = set()
    for index in range(FRAMES):
        cards = cards_of(seen, index)
        header = {m["name"]: m for m in message_of(seen.at(index))["methods"]}
        published = {m["name"]: m for m in found["frames"][index]["methods"]}
        for method, card in cards.items():
            word, severity = card.verdict.headline, str(card.verdict.severity)
            words.add(word)
            assert (header[method]["word"], header[method]["severity"]) == (word, severity)
            assert published[method] == header[method] and word in headlines(panels, index)
        if index % 10 == 0:
            told = tools()["verdict_at"].function(agent, frame=index)["verdicts"]
            assert {row["method"]: row["word"] for row in told if row["frame"] == index} == {
                method: card.verdict.headline for method, card in cards.items()
            }
    assert len(words) > 2, "the run has several states"


def test_its_recording_says_the_same_words(seen: Seen) -> None:
    from rerun.chunk import RrdReader

    said: dict[tuple[int, str], str] = {}
    for chunk in RrdReader(seen.folder / "run.rrd").stream().to_chunks():
        batch = chunk.to_record_batch()
        if str(chunk.entity_path) != "/log":
            continue
        for row in batch.to_pylist():
            method, _, word = row["TextLog:text"][0].partition(": ")
            if word != "keyframe":
                said[row["exposure"], method] = word
    now: dict[str, str] = {}
    assert said
    for index in range(FRAMES):
        now |= {method: word for (at, method), word in said.items() if at == index}
        assert now.items() >= {m: card.verdict.headline for m, card in cards_of(seen, index).items()}.items(), index


@pytest.mark.parametrize("definition", [INLIERS, RESIDUAL, LIVE_ERROR], ids=lambda d: d.key)
def test_what_a_step_gave_is_one_number_everywhere(seen: Seen, definition: Any) -> None:
    key, dock, agent = definition.key, seen.dock, AgentSession(seen.session)
    report = read_run(seen.folder, "one")
    recorded = read_recording(seen.folder / "run.rrd")
    rows = {record.index: record.values_by_method for record in recorded.records()}
    compared = 0
    for index in range(FRAMES):
        for method, card in cards_of(seen, index).items():
            here = FrameRecord(method, seen.run.history[index])
            value = here.number(key)
            assert close(dock[f"{method}.{key}"].get(index), value)
            at = list(report.steps[method].exposures).index(index)
            assert close(float(report.steps[method].columns[key][at]), value)
            told = tools()["verdict_at"].function(agent, frame=index, method=method)["verdicts"][0]["numbers"]
            assert close(told[key], value)
            assert close(rows[index].get(method, {}).get(key), value), "the recording"
            if value is not None:
                compared += 1
                shown = numbers(card)[key]
                wanted = {"inliers": f"{value:.0f} ", "residual_median_px": f"median {value:.2f} px"}
                assert shown.startswith(wanted.get(key, length(value)))
                for check in re.findall(r"(\d+) inliers \(", card.verdict.sentence):
                    assert key != "inliers" or check == f"{value:.0f}", card.verdict.sentence
    assert compared > 20


def test_the_position_error_is_one_number_and_names_its_alignment(seen: Seen) -> None:
    dock, agent, found = seen.dock, AgentSession(seen.session), run_message(seen.state, seen.run)
    compared = 0
    for index in range(FRAMES):
        header = {m["name"]: m for m in message_of(seen.at(index))["methods"]}
        for method, card in cards_of(seen, index).items():
            curve = seen.state[Branches].curves.get(method)
            here = FrameRecord(method, seen.run.history[index], curve)
            if here.error_m is None:
                assert "error" not in numbers(card) and ERROR.label not in header[method]["hint"]
                continue
            compared += 1
            past = [value for at, value in dock[f"{method}.error"].items() if at <= index]
            assert close(past[-1], here.error_m)
            frames, values = found["plots"]["values"][f"{method}.error"]
            assert close([v for f, v in zip(frames, values, strict=True) if f <= index][-1], here.error_m)
            said = f"{length(here.error_m)}, {here.aligned}"
            assert said in header[method]["hint"] and here.aligned in numbers(card)["error"]
            assert numbers(card)["error"].startswith(length(here.error_m))
            told = tools()["verdict_at"].function(agent, frame=index, method=method)["verdicts"][0]["numbers"]
            assert close(told["error_aligned_m"], here.error_m) and told["aligned"] == here.aligned
    assert compared > 20


def test_the_ate_is_one_number_in_header_report_and_answers(seen: Seen) -> None:
    report = read_run(seen.folder, "one")
    assert results([report])
    errors = tools()["trajectory_errors"].function(AgentSession(seen.session))["errors"]
    metrics = json.loads((seen.folder / "metrics.json").read_text(encoding="utf-8"))["methods"]
    for chip in message_of(seen.at(FRAMES - 1))["methods"]:
        wanted = metrics[chip["name"]]["ate_m"]
        if wanted is None:
            continue
        assert chip["error"] == length(wanted) and close(errors[chip["name"]]["ate_m"], wanted)
        assert close(report.metrics[chip["name"]]["ate_m"], wanted)


def test_every_definition_is_a_sentence_with_a_label_of_its_own() -> None:
    assert len({d.label for d in DEFINITIONS.values()}) == len(DEFINITIONS) and all(
        d.text for d in DEFINITIONS.values()
    )


def close(a: float | None, b: float | None) -> bool:
    """Equal but for the digits that are sent."""
    a, b = (None if x is None or x != x else float(x) for x in (a, b))
    return a is b if a is None or b is None else a == pytest.approx(b, rel=6e-5, abs=1e-12)
