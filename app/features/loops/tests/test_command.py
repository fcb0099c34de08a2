"""`ispom loops` on a lap of a simulated pair: every candidate, page, schema, and forks that decide otherwise."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path
from runpy import run_path
from typing import Any

import msgspec
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.playback import Playback
from ispom_app.features.loops.candidate import Court
from ispom_app.features.loops.docket import MOST_OPEN, Docket
from ispom_app.features.loops.page import lines_of

from ispom.ensemble import build
from ispom.estimators.modern import trials
from ispom.estimators.modern.trials import Matches, Trial, collecting_trials
from ispom.methods import Config, method
from ispom.sequences import open_sequence
from ispom.types import Camera
from tests import doubles
from tests.app.helpers import ran
from tests.app.written import breaks_schema

MOST = 6
SCRIPT = Path(__file__).parents[4] / "docs/howto/loops_lap.py"


@pytest.fixture(scope="module")
def lap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example of the how-to: a pair that looks outwards from a circle, and comes back."""
    return run_path(str(SCRIPT))["write_lap"](tmp_path_factory.mktemp("lap"))


@pytest.fixture(scope="module")
def run(lap: Path) -> Path:
    out = lap.parent / "run"
    return ran(lap, out, "--methods", "stereo", "--stereo.loops", "--no-recording")


def listed(out: Path) -> dict[str, Any]:
    return json.loads((out / "loops.json").read_text())


@pytest.fixture(scope="module")
def out(run: Path) -> Path:
    found = run.parent / "loops"
    assert main(["loops", str(run), "--most", str(MOST), "--out", str(found)]) == 0
    return found


def test_all_candidates_are_listed_with_the_rule_that_decided(out: Path) -> None:
    assert not breaks_schema("loops", (out / "loops.json").read_text())
    court = msgspec.json.decode((out / "loops.json").read_bytes(), type=Court)
    accepted = [each for each in court.candidates if each.verdict == "accepted"]
    refused = [each for each in court.candidates if each.verdict == "refused"]
    assert accepted and refused
    for each in accepted:
        assert each.decided_by == "loop_views" and each.truth is not None and each.truth.right
        assert each.pose is not None and each.pose.translation_sigma is not None
    for each in refused:
        rule = next(rule for rule in each.rules if rule.key == each.decided_by)
        assert not rule.passed and all(other.passed for other in each.rules[: each.rules.index(rule)])
    assert {each.decided_by for each in refused} & {rule.key for rule in trials.RULES}
    assert sum(court.counts.values()) == len(court.candidates) == sum(court.decided_by.values())


def test_the_page_shows_some_with_both_images_and_loads_nothing(out: Path) -> None:
    page = (out / "index.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 2 * MOST
    assert not re.search(r"<script|src=\"http|href=\"http", page)
    assert page.count('class="decides"') == MOST


def test_what_if_differs_from_the_frame_on_and_says_what_was_asked(run: Path, out: Path, tmp_path: Path) -> None:
    accepted = [each for each in listed(out)["candidates"] if each["verdict"] == "accepted"]
    refused = next(
        each for each in listed(out)["candidates"] if each["pose"] is not None and each["verdict"] == "refused"
    )
    pairs = [",".join(f"{a['first_frame']}-{a['then_frame']}" for a in accepted)]
    pairs.append(f"{refused['first_frame']}-{refused['then_frame']}")
    assert main(["loops", str(run), "--what-if", *pairs, "--out", str(tmp_path / "out")]) == 0
    without, with_one = listed(tmp_path / "out")["what_if"]
    start = min(each["then_frame"] for each in accepted)
    assert without["asked"] == "refuse" and without["carried_out"] and without["from_frame"] == start
    assert without["first_different_frame"] >= start and without["largest_shift"] > 0
    assert set(without["as_it_was"]["closed"]) == set(pairs[0].split(","))
    assert not set(without["otherwise"]["closed"]) & set(pairs[0].split(","))
    assert with_one["asked"] == "accept" and with_one["carried_out"]
    assert with_one["first_different_frame"] >= refused["then_frame"]
    assert pairs[1] in with_one["otherwise"]["closed"] and pairs[1] not in with_one["as_it_was"]["closed"]


def test_steps_are_the_same_with_and_without_collection(lap: Path) -> None:
    config = Config()
    config = config.with_settings("stereo", method("stereo").config(loops=True))
    plain, watched = (Playback(open_sequence(str(lap)), ("stereo",), config) for _ in range(2))
    while plain.more():
        with collecting_trials():
            one = watched.step()
        other = plain.step()
        assert [s.decisions for s in one.steps] == [s.decisions for s in other.steps]
        for a, b in zip(one.steps, other.steps, strict=True):
            assert (a.world_from_frame is None) == (b.world_from_frame is None)
            if a.world_from_frame is not None and b.world_from_frame is not None:
                assert a.world_from_frame.matrix.tobytes() == b.world_from_frame.matrix.tobytes()
    ends = [found.finish().trajectories["stereo"] for found in (plain, watched)]
    assert ends[0].translations.tobytes() == ends[1].translations.tobytes()


@pytest.mark.skipif(find_spec("mcp") is None, reason="the SDK of agents is an extra")
def test_an_agent_gets_the_candidates_of_a_stretch(run: Path, out: Path) -> None:
    from ispom_app.features.agents.command import agent_session
    from ispom_app.features.agents.options import Mcp

    from tests.app.agents.asking import Agent, asked

    wanted = [each for each in listed(out)["candidates"] if each["verdict"] == "accepted"]
    first = min(each["then_frame"] for each in wanted)

    async def script(agent: Agent) -> list[dict[str, Any]]:
        last = (await agent.ask("summary"))["computed"] - 1
        return (await agent.ask("loop_candidates", first=first, last=last, verdict="accepted"))["rows"]

    with agent_session(Mcp(sources=(str(run),), runs=run.parent), build) as agents:
        agents.open(str(run))
        rows = asked(agents, script)
    assert {(r["first_frame"], r["then_frame"]) for r in rows} == {(w["first_frame"], w["then_frame"]) for w in wanted}
    assert all(row["decided_by"] == "loop_views" and row["truth"]["right"] for row in rows)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--what-if", "5"], "--what-if"),
        (["--what-if", "7-5"], "--what-if"),
        (["--what-if", "1-99999"], "0 to"),
        (["--methods", "stereo"], "is a run"),
    ],
)
def test_mistakes_are_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["loops", str(run), "--out", str(tmp_path / "out"), *arguments]) == 2
    assert said in capsys.readouterr().err


def test_a_docket_keeps_no_more_than_it_shows() -> None:
    sequence = doubles.sequence()
    with Docket(sequence, most=4) as docket:
        for i in range(3 * MOST_OPEN):
            waits = Trial("loop", "video", 0, i + 1)
            out = Trial("loop", "video", 0, i + 1_000_000)
            out.rules[trials.MATCHES.key] = trials.MATCHES.of(i % 7, 12)
            docket.add([waits, out])
            assert len(docket._open) <= MOST_OPEN and sum(map(len, docket._shown.values())) <= 8
        docket.finish()
        assert docket.counts == {"loop.refused": 3 * MOST_OPEN, "loop.undecided": 3 * MOST_OPEN}
        assert len(list(docket.candidates())) == 6 * MOST_OPEN
        assert len(docket.shown()) == 4


def test_matches_are_drawn_where_they_are() -> None:
    camera = Camera(100, 80, 100.0, 100.0, 49.5, 39.5)
    first = np.array([[0.0, 0.0], [9.0, 0.0], [np.nan, np.nan]])
    then = np.array([[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]])
    found = lines_of(Matches(first, then, np.array([True, True, False])), camera, 6.4)
    ((x1, y1, x2, y2), inlier) = found[0]
    assert len(found) == 1 and inlier, "the others are outside of the first image"
    assert (x1, y1) == pytest.approx((316.8, 252.8)) and (x2 - 648, y2) == pytest.approx((380.8, 252.8))
