"""Poses of other programs, and triages, as agents see them: only where a person allowed to look."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.command import agent_session
from ispom_app.features.agents.options import Mcp
from ispom_app.features.evaluation.tools import MOST_ESTIMATES

from ispom.errors import InputError
from ispom.geometry import so3_exp
from ispom.io.trajectories import tum_text
from ispom.sequences import open_sequence
from ispom.types import Trajectory
from tests.app import helpers
from tests.app.agents.asking import Agent, asked
from tests.app.helpers import started
from tests.app.written import breaks_schema
from tests.sequences.kitti_folder import make_drive

SOURCE = "sim:tiny"
FRAMES = 60


@pytest.fixture(scope="module")
def curve() -> Trajectory:
    """60 s of a path that winds, and turns as it does."""
    time = np.linspace(0, 60, 601)
    where = np.column_stack([3 * np.sin(0.4 * time), 2 * np.sin(0.23 * time), time + np.sin(0.31 * time)])
    turns = so3_exp(np.column_stack([0.2 * np.sin(0.5 * time), 0.6 * np.sin(0.3 * time), 0.1 * np.cos(time)]))
    return Trajectory((time * 1e9).astype(np.int64), turns, where)


@pytest.fixture
def agents(tmp_path: Path) -> Iterator[AgentSession]:
    """In whose folder of runs there are poses; nothing is open."""
    (tmp_path / "runs").mkdir()
    session = started(tmp_path / "runs", "", autoplay=False)
    yield AgentSession(session, (), tmp_path / "runs", poses=(tmp_path / "named.tum",))
    session.close(5)


def test_a_wrong_clock_is_audited_and_its_option_is_an_argument(agents: AgentSession, curve: Trajectory) -> None:
    (agents.runs / "truth.tum").write_text(tum_text(curve))
    (agents.runs / "late.tum").write_text(tum_text(replace(curve, times_ns=curve.times_ns + 300_000_000)))
    files = {"reference": "truth.tum", "estimates": ["late.tum"]}

    async def script(agent: Agent) -> None:
        found = await agent.ask("evaluate", **files)
        assert not breaks_schema("evaluate", json.dumps(found))
        (wrong,) = found["estimates"]
        assert [each["key"] for each in wrong["audit"]] == ["offset"] and wrong["ate_rmse_m"] > 0.05
        assert wrong["audit"][0]["option"] == "--offset -0.3"
        (right,) = (await agent.ask("evaluate", **files, offset=-0.3))["estimates"]
        assert not right["audit"] and right["ate_rmse_m"] < 1e-6
        assert "--delta" in await agent.refusal("evaluate", **files, delta="1 mile")
        many = ["late.tum"] * (MOST_ESTIMATES + 1)
        assert str(MOST_ESTIMATES) in await agent.refusal("evaluate", reference="truth.tum", estimates=many)

    asked(agents, script)


def test_only_files_where_the_person_allowed_it_are_read(agents: AgentSession, curve: Trajectory) -> None:
    """Neither by their path, nor by a link, nor as a bag, nor as the times of rows."""
    text, place = tum_text(curve), agents.runs.parent
    (agents.runs / "truth.tum").write_text(text)
    for name in ("named.tum", "private.tum"):
        (place / name).write_text(text)
    (agents.runs / "link.tum").symlink_to(place / "private.tum")
    (agents.runs / "folder").symlink_to(place)
    private = str(place / "private.tum")
    hidden = (private, "../private.tum", "link.tum", "folder/private.tum", f"{private}:/poses", "link.tum:/poses", "..")

    async def script(agent: Agent) -> None:
        for name in (str(place / "named.tum"), "../named.tum", str(agents.runs / "truth.tum")):
            assert (await agent.ask("evaluate", reference="truth.tum", estimates=[name]))["estimates"]
        assert "x" * 80 in await agent.refusal("triage", folder="x" * 5000)
        for name in (*hidden, "missing.tum", "\0"):
            for files in ({"estimates": [name]}, {"reference": name}, {"times": name}):
                asking = {"reference": "truth.tum", "estimates": ["truth.tum"]} | files
                assert repr(name[:80]) in await agent.refusal("evaluate", **asking), name
            assert repr(name[:80]) in await agent.refusal("triage", folder=name), name

    asked(agents, script)


def test_what_is_exchanged_for_a_link_afterwards_is_not_read(
    agents: AgentSession, curve: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The check and the reading are two steps."""
    for path in (agents.runs / "truth.tum", agents.runs.parent / "private.tum"):
        path.write_text(tum_text(curve))
    (agents.runs / "link.tum").symlink_to(agents.runs.parent / "private.tum")
    monkeypatch.setattr(AgentSession, "file", lambda self, name: self.runs / name)

    async def script(agent: Agent) -> None:
        assert "outside" in await agent.refusal("evaluate", reference="truth.tum", estimates=["link.tum"])

    asked(agents, script)


def test_the_judge_sees_inverse_poses_in_the_recording_that_is_open(tmp_path: Path) -> None:
    truth = open_sequence(SOURCE).truth
    assert truth is not None
    inverse = Trajectory.of([(time, pose.inverse()) for time, pose in truth.items()])
    for name, poses in (("right.tum", truth), ("inverse.tum", inverse)):
        (tmp_path / name).write_text(tum_text(poses))
    options = Mcp(sources=(SOURCE,), runs=tmp_path, max_exposures=FRAMES)

    async def script(agent: Agent) -> None:
        assert "open_run" in await agent.refusal("judge", poses="right.tum")
        await agent.ask("open_run", source=SOURCE)
        found = await agent.ask("judge", poses="inverse.tum", frame="rig")
        assert found["verdict"] == "contradicted" and not breaks_schema("judge", json.dumps(found))
        assert [each["kind"] for each in found["all_poses"] if each["found"]] == ["inverse"]
        assert (await agent.ask("judge", poses="right.tum", frame="rig"))["verdict"] == "agrees"
        assert "seconds" in await agent.refusal("judge", poses="right.tum", seconds=1e-6)
        assert await agent.refusal("judge", poses="right.tum", seconds=1e6)
        assert "not be read" in await agent.refusal("judge", poses="/etc/passwd")
        assert "not be read" in await agent.refusal("judge", poses="right.tum", times="/etc/passwd")

    with agent_session(options, helpers.build) as agents:
        asked(agents, script)


def test_a_triage_is_read_and_its_runs_can_be_opened(
    agents: AgentSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ispom_app.features.triage.command.compile_first", lambda *_: None)
    monkeypatch.setattr("ispom_app.features.headless.command.warmup.start", lambda *_: None)
    make_drive(tmp_path / "clips" / "a", right=False)
    (tmp_path / "clips" / "bad.mp4").write_text("no film")

    async def before(agent: Agent) -> None:
        assert "ispom triage" in await agent.refusal("triage")

    async def script(agent: Agent) -> None:
        found = await agent.ask("triage")
        assert found["groups"]["fine"] == found["groups"]["cannot be opened"] == 1 and found["total"] == 2
        assert await agent.ask("triage", folder="checked", group="fine") == found | {
            "total": 1,
            "rows": [row for row in found["rows"] if row["group"] == "fine"],
        }
        keys = {row["group"]: row["open"] for row in found["rows"]}
        assert keys["cannot be opened"] is None
        assert keys["fine"] in {row["key"] for row in (await agent.ask("list_runs"))["rows"]}
        assert "lost" in await agent.refusal("triage", group="great")

    asked(agents, before)
    words = ["triage", str(tmp_path / "clips"), "--workers", "0", "--methods", "monocular"]
    assert main([*words, "--out", str(agents.runs / "checked")], helpers.build) == 1
    names = {path: path.stat().st_mtime_ns for path in agents.runs.rglob("*")}
    asked(agents, script)
    assert names == {path: path.stat().st_mtime_ns for path in agents.runs.rglob("*")}, "nothing is written"
    (agents.runs / "checked" / "triage.json").write_text('{"groups": 1}')

    async def damaged(agent: Agent) -> None:
        assert "triage.json" in await agent.refusal("triage")

    asked(agents, damaged)


def test_named_poses_have_to_be_there(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="--poses"),
        agent_session(Mcp(runs=tmp_path, poses=(tmp_path / "none.tum",)), helpers.build),
    ):
        pass
