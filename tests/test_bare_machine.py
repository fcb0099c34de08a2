"""The commands on a machine that has Python, its wheels, and none of OpenGL, X11, USB, udev or GLib; nothing is cached.

`../shared/tools/bare COMMAND` hides those libraries from a command. The browser runs outside of it.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ispom.child import Child
from tests.app.page.test_browser import Page, browser
from tests.app.page.test_browser import pytestmark as with_browser

__all__ = ["browser"]
ROOT = Path(__file__).parents[1]
BARE = ROOT.parent / "shared" / "tools" / "bare"
NO_NAMESPACE = 125
ISPOM = [sys.executable, "-m", "ispom_app"]


@pytest.fixture(scope="module")
def bare() -> list[str]:
    """What a command is to begin with."""
    if not BARE.is_file():
        pytest.skip("../shared/tools/bare is not there")
    if subprocess.run([BARE, "true"], capture_output=True, check=False).returncode == NO_NAMESPACE:
        pytest.skip("no mount namespace can be made here: it takes root")
    return [str(BARE)]


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A home in which nothing is kept yet."""
    home = str(tmp_path_factory.mktemp("home"))
    return {"HOME": home, "XDG_CACHE_HOME": f"{home}/cache", "PYTHONPATH": str(ROOT)}


@pytest.fixture(scope="module")
def run(bare: list[str], environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the simulation's first exposures, written by `ispom run`."""
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    command = ["run", "sim:tiny", "--variant", "paper", "--max-exposures", "40", "--out", str(folder)]
    execute([*bare, *ISPOM, *command], environment, folder.parent)
    return folder


def execute(command: list[str], environment: dict[str, str], folder: Path) -> str:
    """Its standard output; it must succeed, and say nothing on standard error."""
    env = {**os.environ, **environment}
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True, text=True, check=False)
    assert not done.returncode and not done.stderr, done.stderr
    return done.stdout


def test_a_run_is_complete(run: Path) -> None:
    assert not (run / "INCOMPLETE").exists()
    assert json.loads((run / "metrics.json").read_text()) and (run / "run.rrd").stat().st_size > 10_000


def test_it_is_reported_evaluated_and_exported(
    bare: list[str], environment: dict[str, str], run: Path, tmp_path: Path
) -> None:
    estimate = str(next(run.glob("stereo*.tum")))
    for command in (
        ["report", str(run), "--out", str(tmp_path / "report.html")],
        ["evaluate", str(run / "truth.tum"), estimate, "--json", str(tmp_path / "errors.json")],
        ["export", str(run), "--format", "ply", "--out", str(tmp_path / "ply")],
    ):
        execute([*bare, *ISPOM, *command], environment, tmp_path)
    assert (tmp_path / "report.html").stat().st_size > 10_000
    assert json.loads((tmp_path / "errors.json").read_text()) and list((tmp_path / "ply").iterdir())


def test_what_is_compiled_runs(bare: list[str], environment: dict[str, str], tmp_path: Path) -> None:
    script = (
        "import numpy as np; from ispom.numerics.twist import moved; "
        "print(moved(np.eye(3)[None], np.zeros((1, 3)), np.ones((1, 6)))[1])"
    )
    assert execute([*bare, sys.executable, "-c", script], environment, tmp_path).startswith("[[1.")


@pytest.mark.parametrize("home", ["/dev/null", ""], ids=["home is no folder", "no home"])
def test_help_needs_no_place_to_write_to(bare: list[str], tmp_path: Path, home: str) -> None:
    nowhere = {"HOME": home, "XDG_CACHE_HOME": home, "TMPDIR": "/dev/null", "PYTHONPATH": str(ROOT)}
    assert "demo" in execute([*bare, *ISPOM, "--help"], nowhere, tmp_path)


@pytest.fixture(scope="module")
def demo(bare: list[str], environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of `ispom demo`."""
    folder = tmp_path_factory.mktemp("demo")
    script = "import os, sys; os.chdir(sys.argv[1]); os.execv(sys.argv[2], sys.argv[2:])"
    start = [sys.executable, "-c", script, str(folder), *bare, *ISPOM, "demo", "--port", "0", "--no-browser"]
    child = Child(["sh", "-c", 'exec "$@" 2>&1', "sh", *start], environment)
    said = ""
    for line in child.answers:
        said += line.decode()
        if found := re.search(r"ISPOM is at (\S+)", said):
            break
    else:
        raise AssertionError(f"the demo {child.ending()}: {said}")
    yield found[1]
    child.stop()


@with_browser
def test_the_demo_shows_its_first_exposures(browser, demo: str) -> None:
    page = Page(browser, demo)
    page.until("state.index >= 3", "the first exposures", 240_000)  # compiled first
    page.tab.locator("#cover").wait_for(state="hidden")
    page.until("window.ispom.viewer.stage?.shown", "Rerun to show an exposure")
    assert not [notice for notice in page.state["notices"] if notice["kind"] == "error"]
