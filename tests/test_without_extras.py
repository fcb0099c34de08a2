"""Every command in an environment without extras: it works, or names the extra that it needs in one sentence."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from ispom_app.cli.commands import COMMANDS

from ispom.child import Child
from tests.without_extras import PROJECT, hidden_modules, hide_extras

pytestmark = pytest.mark.timeout(900)
ISPOM = [sys.executable, "-P", "-m", "ispom_app"]
TINY = ["sim:tiny", "--max-exposures", "30", "--variant", "paper"]
RAN = ["sim:tiny", "--max-exposures", "40", "--methods", "monocular", "stereo.paper"]
"""`blame` takes a method that says what it solves."""
RUN, OUT = "{run}", "{out}"
WORKS = {
    "blame": [RUN, "--at", "35", "--method", "monocular"],
    "budget": [RUN, "--methods", "stereo.paper", "--repeats", "1"],
    "calibrate": ["stereo", "sim:calibration?views=8", "--target", "aprilgrid:6x6:0.03:0.3"],
    "diff": [RUN, RUN],
    "doctor": [RUN, "--seconds", "1"],
    "evaluate": ["{run}/truth.tum", "{run}/stereo.paper.tum"],
    "experiment": ["{plan}", "--out", OUT],
    "export": [RUN, "--format", "ply", "--out", OUT],
    "fork": [RUN, "--at", "6", "--out", OUT],
    "gate": ["{plan}", "--baseline", "{experiment}", "--candidate", "{experiment}", "--out", OUT],
    "grade": ["stereo.paper", "--runs", "1", "--max-exposures", "30", "--no-contract"],
    "judge": ["{run}/truth.tum", *TINY[:3]],
    "loops": ["sim:tiny?duration_s=1", "--methods", "stereo", "--out", OUT],
    "map": [RUN, "--out", OUT],
    "new-method": ["mine", "--out", OUT],
    "passport": [RUN, "--to", OUT],
    "perturb": [RUN],
    "publish": [RUN, "--out", OUT],
    "repair": [RUN],
    "report": [RUN, "--out", "{out}/report.html"],
    "run": [*TINY, "--out", OUT],
    "schema": ["judge"],
    "shrink": [RUN, "--out", OUT, "--trials", "3"],
    "sources": ["sim:tiny"],
    "triage": [RUN, "--out", OUT, "--seconds", "1"],
    "undecided": [*TINY[:3]],
}
"""What each command is tried with."""
SERVES = {"app": TINY, "demo": [], "learn": []}
"""Commands that go on until they are ended."""
NEEDS = {
    "mcp": ("agents", ["mcp"]),
    "agents beside the page": ("agents", ["app", "sim:tiny", "--no-browser", "--port", "0", "--agents", "0"]),
    "several runs": ("cluster", ["experiment", "{plan}", "--out", OUT, "--workers", "2"]),
    "plots": ("plots", ["evaluate", "{run}/truth.tum", "{run}/stereo.paper.tum", "--plots", "{out}/plots"]),
    "fusion": ("fusion", ["run", "sim:tiny?sensors=imu", "--methods", "fused", "--max-exposures", "3", "--out", OUT]),
    "bags": ("bags", ["sources", "{bag}"]),
    "latitude and longitude": ("fusion", ["sources", "sim:tiny", "--sensors", "{fixes}"]),
}
"""What cannot be had without an extra."""
FAILED = {
    "doctor": (1,),
    "calibrate": (1,),
    "gate": (2, 3),
    "judge": (0, 1, 3),
    "map": (2,),
    "shrink": (2,),
    "triage": (1,),
}
"""Exit codes that are no failure of the program: there is no cause, too few views or runs, or no system library."""
FIXES = "gnss: {file: fixes.csv, sigma_m: 1, rig_from_gnss: {translation_m: [0, 0, 0], rotation_xyzw: [0, 0, 0, 1]}}\n"
PLAN = "title: Tiny\nsources: [sim:tiny]\nseeds: [0]\nmax_exposures: 30\nmethods: [stereo.paper]\n"


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A run, a plan and its experiment, made without extras."""
    folder = tmp_path_factory.mktemp("without_extras")
    found = {"run": str(folder / "run"), "plan": str(folder / "plan.yaml"), "experiment": str(folder / "experiment")}
    (folder / "plan.yaml").write_text(PLAN)
    for command in (["run", *RAN, "--out", found["run"]], ["experiment", found["plan"], "--out", found["experiment"]]):
        done = execute(command, folder)
        assert not done.returncode, done.stderr
    return found


def environment(folder: Path) -> dict[str, str]:
    hooks = folder / "hooks"
    hooks.mkdir(exist_ok=True)
    return {**os.environ, **hide_extras(hooks)}


def execute(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*ISPOM, *command], env=environment(folder), cwd=folder, capture_output=True, text=True, check=False
    )


def filled(words: list[str], places: dict[str, str], folder: Path) -> list[str]:
    return [word.format(**places, out=folder / "out") if "{" in word else word for word in words]


def test_what_extras_bring_is_hidden(tmp_path: Path) -> None:
    """All that pyproject.toml lists, so that a new extra is covered; nothing of the project's own."""
    hidden = hidden_modules()
    assert {"matplotlib", "rosbags", "gtsam", "small_gicp", "distributed", "mcp", "evo"} <= hidden
    assert hidden.isdisjoint(
        {"numpy", "cv2", "numba", "viser", "rerun", "tyro", "yaml", "trimesh", "ispom", "ispom_app"}
    )
    code = f"import importlib.util; print([m for m in {sorted(hidden)!r} if importlib.util.find_spec(m)])"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment(tmp_path), capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]", done.stderr
    assert {extra for extra, _ in NEEDS.values()} == set(PROJECT["optional-dependencies"]) - {
        "all",
        "test",
        "docs",
        "check",
    }


def test_every_command_is_tried() -> None:
    assert set(COMMANDS.names()) == {*WORKS, *SERVES, "mcp"}


@pytest.mark.parametrize("name", WORKS)
def test_a_command_works(name: str, places: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    done = execute([name, *filled(WORKS[name], places, tmp_path)], tmp_path)
    assert "Traceback" not in done.stderr and "ModuleNotFound" not in done.stderr, done.stderr
    assert done.returncode in (0, *FAILED.get(name, ())), done.stderr
    assert done.returncode != 2 or done.stderr.splitlines()[-1].startswith("ispom: "), done.stderr


@pytest.mark.parametrize("name", NEEDS)
def test_what_needs_an_extra_names_it(name: str, places: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    bag = tmp_path / "a.mcap"
    bag.write_bytes(b"\x89MCAP0\r\n")
    (tmp_path / "fixes.yaml").write_text(FIXES)
    (tmp_path / "fixes.csv").write_text("time_s,lat,lon,height\n0,49,8.4,100\n1,49,8.4,100\n")
    extra, words = NEEDS[name]
    done = execute(filled(words, places | {"bag": str(bag), "fixes": str(tmp_path / "fixes.yaml")}, tmp_path), tmp_path)
    assert done.returncode == 2 and f"ispom[{extra}]" in done.stderr, done.stderr
    (sentence,) = done.stderr.strip().splitlines()
    assert sentence.startswith("ispom: ")


@pytest.mark.parametrize("name", SERVES)
def test_a_page_is_served(name: str, tmp_path: Path) -> None:
    script = 'cd "$1"; shift; exec "$@" 2>&1'
    words = [name, *SERVES[name], "--port", "0", "--no-browser"]
    child = Child(["sh", "-c", script, "sh", str(tmp_path), *ISPOM, *words], environment(tmp_path))
    said = ""
    try:
        for line in child.answers:
            said += line.decode()
            if re.search(r"ISPOM is at (\S+)", said):
                return
        raise AssertionError(f"it {child.ending()}: {said}")
    finally:
        child.stop()
