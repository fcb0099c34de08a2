"""The table of commands: every entry names what is there, and help texts load nothing heavy."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys

import pytest
from ispom_app.cli import commands
from ispom_app.cli.commands import COMMANDS, MOVED
from ispom_app.cli.main import main

from ispom.registry import named

HEAVY = ("viser", "rerun", "aiohttp", "open3d", "trimesh", "matplotlib", "plotly", "pyarrow", "scipy.optimize")
CODE = f"""
import sys
from contextlib import suppress
from ispom_app.cli.main import main
with suppress(SystemExit):
    main(["--help"])
sys.stderr.write(" ".join(name for name in {HEAVY} if name in sys.modules))
"""


@pytest.mark.parametrize("name", COMMANDS.names())
def test_a_command_has_a_function_that_takes_what_it_is_given(name: str) -> None:
    command = COMMANDS.get(name)
    assert isinstance(command.function, str)
    function = named(command.function, commands.APP)
    options, *needs = inspect.signature(function).parameters.values()
    given = [each.name for each in needs if each.name in ("words", "builder")]
    assert given == list(command.needs)
    assert all(each.name in given or each.default is not inspect.Parameter.empty for each in needs)
    assert command.options_class().__doc__
    if options.annotation != "Serve":  # of several commands
        assert options.annotation == command.options_class().__name__


@pytest.mark.parametrize("name", MOVED)
def test_a_command_that_was_moved_says_where_it_is(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert name not in COMMANDS.names() and MOVED[name].split()[1] in COMMANDS.names()
    for words in ([name], [name, "--help"], [name, "chessboard:9x6:0.0242"]):
        assert main(words) == 2
        out, err = capsys.readouterr()
        assert not out and err.count("\n") == 1 and MOVED[name] in err


def test_the_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert not done.stderr
    for name, command in COMMANDS.items().items():
        assert bool(re.search(rf"^[^\w]*{name}\s", done.stdout, re.MULTILINE)) == command.listed, name
