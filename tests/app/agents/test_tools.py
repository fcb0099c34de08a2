"""What the tools answer, on stand-ins and on the run of a folder."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.conditions.evaluate import hits
from ispom_app.engine.conditions.parser import parse
from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.command import agent_session
from ispom_app.features.agents.options import Mcp
from ispom_app.features.agents.tool import MOST_ROWS, tools
from ispom_app.session.branches.state import Branches
from mcp_types import ImageContent
from PIL import Image

from tests import doubles
from tests.app.agents.asking import Agent, asked
from tests.app.helpers import build_full, open_source, started
from tests.sequences.kitti_folder import make_drive

FRAMES = 14
OTHER = "double:7"


@pytest.fixture
def agents(tmp_path: Path) -> Iterator[AgentSession]:
    session = started(tmp_path, f"double:{FRAMES}", autoplay=False, builder=build_full)
    yield AgentSession(session, (f"double:{FRAMES}", OTHER), tmp_path)
    session.close(5)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs on one drive; the second one has more frames."""
    place = tmp_path_factory.mktemp("runs")
    drive = str(make_drive(place / "kitti", FRAMES))
    for name, frames in (("a", FRAMES - 2), ("b", FRAMES)):
        words = [
            "run",
            drive,
            "--stereo-every",
            "2",
            "--max-exposures",
            str(frames),
            "--out",
            str(place / "runs" / name),
        ]
        assert main(words, build_full) == 0
    return place / "runs"


def test_every_tool_says_what_it_is_and_what_it_takes(agents: AgentSession) -> None:
    async def script(agent: Agent):
        return (await agent.client.list_tools()).tools

    found = {tool.name: tool for tool in asked(agents, script)}
    assert found.keys() == tools().keys()
    for name, tool in found.items():
        assert tool.description and tool.annotations.read_only_hint == (not tools()[name].changes)
        assert all("description" in each for each in tool.input_schema["properties"].values()), name
        assert tool.input_schema["additionalProperties"] is False


def test_a_source_is_computed_and_looked_at(agents: AgentSession) -> None:
    async def script(agent: Agent) -> None:
        before = await agent.ask("summary")
        assert (before["computed"], before["frames"]) == (0, FRAMES + 2)
        assert "compute" in await agent.refusal("events")
        assert (await agent.ask("compute", frame=5))["computed"] >= 6
        assert (await agent.ask("compute"))["done"]
        after = await agent.ask("summary")
        assert after["computed"] == FRAMES + 2 and not after["computing"]
        series = agents.run.series
        tracking = np.count_nonzero([series.stepped(["stereo"], i) for i in range(len(series))])
        assert after["methods"]["stereo"]["statuses"] == {"tracking": tracking}
        steps = await agent.ask("steps", method="stereo")
        assert steps["total"] == tracking
        first = dict(zip(steps["columns"], steps["rows"][0], strict=True))
        assert first["status"] == "tracking"
        assert first["x"] == pytest.approx(doubles.pose_at(round(first["time_s"] * 1e9)).translation[0], rel=1e-5)

    asked(agents, script)


def test_rows_come_in_pages(agents: AgentSession) -> None:
    async def script(agent: Agent) -> None:
        await agent.ask("compute")
        whole = await agent.ask("steps", method="monocular")
        rows, start = [], 0
        while start is not None:
            page = await agent.ask("steps", method="monocular", start=start, limit=4)
            assert len(page["rows"]) <= 4
            rows, start = rows + page["rows"], page["next_start"]
        assert rows == whole["rows"] and len(rows) == whole["total"] >= FRAMES
        assert str(MOST_ROWS) in await agent.refusal("steps", method="monocular", limit=MOST_ROWS + 1)
        assert (await agent.ask("steps", method="monocular", first=3, last=4))["total"] <= 2

    asked(agents, script)


def test_a_condition_holds_where_the_engine_says(agents: AgentSession) -> None:
    condition = "monocular.x > 0.1 and exposure < 9"

    async def script(agent: Agent) -> None:
        await agent.ask("compute")
        found = await agent.ask("condition_test", expression=condition)
        series = agents.run.series
        assert found["total"] == hits(parse(condition, series.quantities), series, len(series)) > 0
        assert all(row["values"]["monocular.x"] > 0.1 and row["frame"] < 9 for row in found["rows"])
        assert "column 1" in await agent.refusal("condition_test", expression="__import__('os')")

    asked(agents, script)


def test_unknown_names_and_arguments_are_answered_with_what_there_is(agents: AgentSession) -> None:
    async def script(agent: Agent) -> None:
        await agent.ask("compute")
        assert "monocular" in await agent.refusal("steps", method="sterer")
        assert "quantities" in await agent.refusal("checks_over_time", key="stereo.nothing")
        assert f"0 to {FRAMES + 1}" in await agent.refusal("verdict_at", frame=99)
        assert "frme" in await agent.refusal("verdict_at", frame=1, frme=2)
        assert "lost" in await agent.refusal("events", kind="explosion")
        assert "no_such_tool" in await agent.refusal("no_such_tool")
        assert (await agent.ask("quantities", contains="parallax"))["total"] > 0

    asked(agents, script)


def test_an_event_is_shrunk_to_the_frames_that_it_needs(agents: AgentSession) -> None:
    async def script(agent: Agent) -> None:
        await agent.ask("compute")
        lost = next(row for row in (await agent.ask("events", kind="lost"))["rows"] if row["method"] == "integrated")
        found = await agent.ask("shrink", kind="lost", frame=lost["frame"], method="integrated", trials=10)
        assert found["methods"] == ["integrated"] and found["frames"][-1] == lost["frame"] == found["event"]["frame"]
        assert len(found["tried"]) == 10 and not found["complete"] and found["command"] is None
        assert await agent.refusal("shrink", kind="unreadable")
        assert "pair" in await agent.refusal("shrink", kind="explosion")
        assert await agent.refusal("shrink", trials=10_000) and await agent.refusal("shrink", seconds=0)

    asked(agents, script)


def test_a_picture_is_an_image_of_the_frame(agents: AgentSession) -> None:
    async def script(agent: Agent) -> None:
        await agent.ask("compute", frame=3)
        bare, drawn = [
            (await agent.result("picture", frame=2, method=method, width=320)).content[0]
            for method in ("", "monocular")
        ]
        images = []
        for content in (bare, drawn):
            assert isinstance(content, ImageContent)
            images.append(np.asarray(Image.open(BytesIO(base64.b64decode(content.data)))))
        assert images[0].shape == (240, 320, 3) == images[1].shape
        assert (images[0] != images[1]).any()
        assert await agent.refusal("picture", frame=2, width=10_000)

    asked(agents, script)


def test_nothing_is_changed_unless_that_is_allowed(agents: AgentSession) -> None:
    async def script(agent: Agent) -> None:
        await agent.ask("compute")
        for name in [tool.name for tool in tools().values() if tool.changes]:
            assert "--allow-changes" in await agent.refusal(name, frame=3, settings={"stereo.max-tracks": 200})
        assert "--allow-changes" in await agent.refusal("open_run", source=OTHER, discard=True)
        assert len(agents.state[Branches].all) == 1

    log: list[str] = []
    asked(agents, script, log)
    assert [line.split()[1] for line in log] == ["compute", "fork", "open_run"]
    assert ["refused" in line for line in log] == [False, True, True]


def test_a_fork_is_made_and_compared_where_changes_are_allowed(agents: AgentSession) -> None:
    agents.allow_changes = True

    async def script(agent: Agent) -> None:
        await agent.ask("compute")
        fork = await agent.ask("fork", frame=4, settings={"stereo.max-tracks": 200})
        assert fork["first_frame"] == 5 and len(fork["changes"]) == 1
        assert "3000" in await agent.refusal("fork", frame=4, settings={"stereo.max-tracks": 10**6})
        assert "max_tracks" in await agent.refusal("fork", frame=4, settings={"stereo.max-trucks": 200})
        await agent.ask("compute")
        found = await agent.ask("diff", run_a="branch:0", run_b=f"branch:{fork['branch']}")
        assert found["finished"] and found["alike"], "the stand-ins do not look at settings"
        assert (await agent.ask("open_branch", number=0))["computed"] == FRAMES + 2
        assert (await agent.ask("open_run", source=OTHER))["frames"] == 8, "the run and its fork stay"

    asked(agents, script)


def test_only_what_is_named_or_in_the_folder_of_runs_is_opened(agents: AgentSession, tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()

    async def script(agent: Agent) -> None:
        for source in ("/etc/passwd", "../outside", str(tmp_path), "camera:0", "http://127.0.0.1/x", "double:9"):
            assert "not be opened" in await agent.refusal("open_run", source=source)
            assert "not be opened" in await agent.refusal("diff", run_a=source, run_b=source)
        assert (await agent.ask("open_run", source=OTHER))["frames"] == 8

    asked(agents, script)


def test_runs_of_a_folder_are_listed_opened_and_compared(runs: Path, tmp_path: Path) -> None:
    session = started(tmp_path, "", opener=open_source, builder=build_full, autoplay=False)
    try:
        agents = AgentSession(session, (), runs)

        async def script(agent: Agent) -> None:
            assert "open_run" in await agent.refusal("summary")
            listed = (await agent.ask("list_runs"))["rows"]
            assert {row["key"] for row in listed} == {"a", "b"}
            opened = await agent.ask("open_run", source="b")
            assert opened["stored_run"] and opened["computed"] == opened["frames"] > FRAMES - 2
            same = await agent.ask("diff", run_a="b", run_b="b")
            assert same["alike"] and not same["settings"] and not same["first"]
            found = await agent.ask("diff", run_a="a", run_b="b")
            assert [s for s in found["settings"] if s["name"] == "max_exposures"]
            assert found["first"][0]["frame"] == FRAMES - 2

        asked(agents, script)
    finally:
        session.close(5)


def test_no_image_is_shown_that_the_folder_of_a_stranger_names(tmp_path: Path) -> None:
    """Its run.yaml may name anything on the disk; and what stands where a run's images were need not be those."""
    drive, runs = make_drive(tmp_path / "kitti", FRAMES), tmp_path / "runs"
    for name in ("own", "changed", "strange"):
        words = ["run", str(drive), "--no-recording", "--out", str(runs / name)]
        assert main(words, build_full) == 0
    strange = runs / "strange" / "run.yaml"
    strange.write_text(strange.read_text().replace("# Written on this machine", "# Written elsewhere"))
    options = Mcp(runs=runs)

    def look(key: str) -> str | None:
        with agent_session(options, build_full) as agents:

            async def script(agent: Agent) -> str | None:
                await agent.ask("open_run", source=key)
                found = await agent.result("picture", frame=2)
                return found.content[0].text if found.is_error else None

            return asked(agents, script)

    assert look("own") is None
    assert "on this machine" in (look("strange") or "")
    first, second = sorted((drive / "image_0").iterdir())[:2]
    second.write_bytes(first.read_bytes())
    assert look("changed") is not None


def test_a_source_that_is_named_opens_nothing_that_its_own_file_names_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "given").mkdir()
    make_drive(tmp_path / "given" / "kitti", FRAMES)
    private = make_drive(tmp_path / "private", FRAMES) / "image_0"
    linked = make_drive(tmp_path / "given" / "linked", FRAMES)
    plain = tmp_path / "given" / "kitti" / linked.relative_to(tmp_path / "given" / "linked")
    image = sorted((linked / "image_0").iterdir())[2]
    image.unlink()
    image.symlink_to(private / image.name)

    def seen(source: Path, *named: Path) -> bool:
        with agent_session(Mcp(sources=(str(source), *map(str, named))), build_full) as agents:

            async def script(agent: Agent) -> bool:
                await agent.ask("open_run", source=str(source))
                await agent.result("compute")
                return not (await agent.result("picture", frame=2 * 2)).is_error

            return asked(agents, script)

    assert seen(plain)
    assert not seen(linked)
    assert seen(linked, private)


def test_a_crash_is_logged_and_no_detail_reaches_the_agent(
    agents: AgentSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(agents: AgentSession, series: object) -> None:
        raise RuntimeError("a detail")

    monkeypatch.setattr(AgentSession, "stretch", crash)

    async def script(agent: Agent) -> str:
        return await agent.refusal("events")

    log: list[str] = []
    assert "detail" not in asked(agents, script, log)
    assert "failed" in log[0]
