"""What can be added without an edit: a feature with its panel by a folder, a quantity by a file, a command by an entry
point. In processes of their own, for what is registered stays registered. (Kinds of
events: app/features/events/tests/test_log.py.)"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

DOORS = Path(__file__).parent / "doors"
FEATURE = """
from pathlib import Path
import ispom_app.features
ispom_app.features.__path__.append({folder!r})
from ispom_app.features.greeting.commands import Greet
from ispom_app.features.greeting.state import Greetings
from ispom_app.views.viser.screen import Screen
from ispom_app.views.web.messages import command_of, keys, message_of
from tests import doubles
from tests.app.helpers import started, wait_for

session = started(Path({out!r}), opener=lambda source, options=None: doubles.sequence(5))
wait_for(lambda: session.state.phase == "ready", "the run")
assert command_of('{{"do": "greet", "times": 2}}') == Greet(2)
assert any(key["name"] == "greet" and key["command"] == {{"do": "greet", "times": 1}} for key in keys())
session.post(command_of('{{"do": "greet", "times": 2}}'))
wait_for(lambda: session.state[Greetings].count == 2, "two greetings")
assert message_of(session.state)["greetings"] == 2
from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.tool import tools
assert tools()["greet"].changes
assert tools()["greet"].function(AgentSession(session), times=3) == {{"count": 5}}
screen = Screen(session)
screen.show_tabs(screen.tabs)
screen.paint()
assert [panel.text.content for panel in screen.panels if hasattr(panel, "text")] == ["greeted 5 times"]
screen.server.stop()
session.close(5.0)
print("done")
"""
COMMAND = """
import importlib.metadata, sys
from ispom import registry
entry = importlib.metadata.EntryPoint("hello", "tests.app.doors.command:HELLO", "ispom.commands")
registry.entry_points = lambda group: [entry] if group == "ispom.commands" else []
from ispom_app.cli.main import main
sys.exit(main(["hello", "--name", "there"]))
"""
QUANTITY = """
import ispom_app.engine.history.step_quantities as listed
listed.__path__.append({folder!r})
from ispom_app.engine.history.quantities import STEP_QUANTITIES, quantities
from ispom_app.engine.run_folder.step_log import STEP_COLUMNS
assert STEP_QUANTITIES[0].key == "status" and "pose_count" in [quantity.key for quantity in STEP_QUANTITIES]
assert "stereo.pose_count" in quantities(("stereo",)) and "pose_count" in STEP_COLUMNS
assert quantities(("stereo",))["stereo.speed"].unit == "1/s" and "speed" not in STEP_COLUMNS
from ispom_app.engine.history.quantities import row_with
pose = {{"y": 0, "z": 0, "qx": 0, "qy": 0, "qz": 0, "qw": 1}}
row = row_with({{}}, 0, 10**9, {{"stereo": {{"x": 1.0, **pose}}}})
assert row_with(row, 1, 3 * 10**9, {{"stereo": {{"x": 2.0, **pose}}}})["stereo"]["speed"] == 0.5
print("done")
"""


def ran(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=DOORS.parents[2], capture_output=True, text=True, timeout=120, check=False
    )


def test_a_feature_is_a_folder(tmp_path: Path) -> None:
    done = ran(FEATURE.format(folder=str(DOORS / "feature"), out=str(tmp_path)))
    assert done.returncode == 0 and done.stdout.endswith("done\n"), done.stderr


def test_a_command_is_an_entry_point() -> None:
    done = ran(COMMAND)
    assert done.returncode == 3 and done.stdout == "hello there\n", done.stderr


def test_a_quantity_is_a_file() -> None:
    done = ran(QUANTITY.format(folder=str(DOORS / "quantities")))
    assert done.returncode == 0 and done.stdout == "done\n", done.stderr
