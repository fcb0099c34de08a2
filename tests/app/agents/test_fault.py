"""An agent finds a fault that it was not told of, by calls only."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import Any

from ispom_app.features.agents.command import agent_session
from ispom_app.features.agents.options import Mcp
from mcp import StdioServerParameters

from ispom.ensemble import build
from ispom.sequences import open_sequence
from tests.app.agents.asking import Agent, asked, connected, first_failing_check

FROM_S = 1.0
SOURCE = f"sim:tiny?fault=darkness:factor=0.02,from_s={FROM_S}"
FRAMES = 38
FIRST_CHECK = {"monocular": "monocular.pose_points", "stereo": "stereo.described_points"}
"""By method: what it finds no points for in the dark, the pose or the last search."""


def first_dark_frame(kind: str) -> int:
    """From the truth that the agent does not see."""
    sequence = open_sequence(SOURCE, max_exposures=FRAMES)
    times_s = (sequence.times_ns - sequence.times_ns[0]) / 1e9
    return next(i for i in range(len(sequence)) if sequence.kinds[i] == kind and times_s[i] >= FROM_S)


def test_darkness_is_found_at_its_first_frame(tmp_path: Path) -> None:
    options = Mcp(sources=(SOURCE,), runs=tmp_path, methods=tuple(FIRST_CHECK), max_exposures=FRAMES)
    with agent_session(options, build) as agents:
        agents.open(SOURCE)

        async def script(
            agent: Agent,
        ) -> tuple[dict[str, tuple[str, int]], dict[str, Any], dict[str, Any], dict[str, Any]]:
            found = {method: await first_failing_check(agent, method) for method in FIRST_CHECK}
            earliest = (await agent.ask("first_failures"))["rows"][0]
            assert (earliest["key"], earliest["first_frame"]) == min(found.values(), key=lambda each: each[1])
            bright = first_dark_frame("video") - 2
            return (
                found,
                await agent.ask("doctor", seconds=600.0, settings=False),
                await agent.ask("blame", frame=bright, method="monocular"),
                await agent.ask("shrink", kind="lost", method="monocular", seconds=600.0),
            )

        found, diagnosis, blamed, shrunk = asked(agents, script)
    kinds = {"monocular": "video", "stereo": "stereo"}
    assert found == {m: (key, first_dark_frame(kinds[m])) for m, key in FIRST_CHECK.items()}
    assert diagnosis["causes"][0] == "darkness"
    (row,) = blamed["methods"]
    assert row["method"] == "monocular" and {"track", "group"} & {part["kind"] for part in row["parts"]}
    assert shrunk["methods"] == ["monocular"] and shrunk["event"]["frame"] == first_dark_frame("video")
    assert shrunk["complete"] and len(shrunk["frames"]) < shrunk["of_frames"] / 2 and shrunk["command"] is None
    assert {each["outcome"] for each in shrunk["tried"]} <= {"remains", "gone", "anywhere"}


def test_over_standard_input_and_output(tmp_path: Path) -> None:
    """As a desktop agent starts it. What the log has, has the calls, and nothing else is on standard output: the client
    would not understand it."""
    log = tmp_path / "calls.log"
    arguments = ["-m", "ispom_app", "mcp", SOURCE, "--methods", "stereo.paper", "--max-exposures", str(FRAMES)]
    server = StdioServerParameters(
        command=sys.executable, args=[*arguments, "--log", str(log)], env=dict(os.environ), cwd=tmp_path
    )

    async def script(agent: Agent) -> tuple[str, int]:
        return await first_failing_check(agent, "stereo.paper")

    key, frame = asyncio.run(connected(server, script))
    assert key.startswith("stereo.paper.") and frame == first_dark_frame("stereo")
    called = [line.split()[1] for line in log.read_text().splitlines()]
    assert called[-3:] == ["events", "verdict_at", "checks_over_time"] and set(called[:-3]) == {"compute"}
